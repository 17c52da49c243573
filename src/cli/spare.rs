//! Where pages go: not over what they are made of.

use std::path::Path;

use super::error::Error;

/// Checks, before any work is done, that a page can go where `--html` says and replaces no input.
pub(super) fn spare<'a>(
    page: &Path,
    inputs: impl IntoIterator<Item = &'a Path>,
) -> Result<(), Error> {
    let shown = page.display();
    if page.as_os_str() == "-" {
        return Err(Error::Usage("--html -: pages are files; name one".to_owned()));
    }
    let folder = page.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        return Err(Error::NoFolder { page: page.to_owned(), folder: folder.to_owned() });
    }
    let same = |input: &&Path| match (input.canonicalize(), page.canonicalize()) {
        (Ok(input), Ok(page)) => input == page,
        _ => false,
    };
    match inputs.into_iter().find(same) {
        None => Ok(()),
        Some(input) => Err(Error::Usage(format!(
            "--html {shown}: that is {}, which the page is made of and would replace; name another \
             file",
            input.display()
        ))),
    }
}
