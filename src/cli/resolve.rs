//! What `--filter` means, with another radius where one is asked for.

use super::error::Error;
use crate::filter::{Filter, FindError};

/// The filter that a text stands for, with another radius if one is given.
pub(super) fn resolve(text: &str, radius: Option<u32>) -> Result<Filter, Error> {
    let filter = Filter::find(text).map_err(|error| match error {
        FindError::File(error) => Error::FilterFile(error),
        FindError::Unknown { .. } | FindError::NoExpression { .. } => {
            Error::Usage(format!("--filter: {error}"))
        }
    })?;
    match radius {
        Some(radius) => Ok(filter.resized(radius)?),
        None => Ok(filter),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::Window;

    #[test]
    fn a_radius_is_applied_and_errors_have_their_status() {
        let expression = resolve("exp(-distance2(normal, normal))", Some(3)).expect("parses");
        assert_eq!(expression.paper().expect("one gather").window, Window::dense(3));
        assert_eq!(resolve("no/such/file.toml", None).unwrap_err().status(), 1);
        assert_eq!(resolve("bilatral", None).unwrap_err().status(), 2);
    }
}
