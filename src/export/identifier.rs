//! Names that compilers accept.
//!
//! A filter may be called anything. Its identifier is made of ASCII letters,
//! digits and single underscores, starts with a letter and is no longer than
//! what compilers promise to tell apart with a suffix behind it. It is only used
//! with a suffix (`name_weight`), so that keywords are no concern.

/// Characters kept: 63 significant ones are C99's promise, less a suffix.
const LONGEST: usize = 40;

/// The identifier for a name.
pub(super) fn of(name: &str) -> String {
    let mut words = String::new();
    for word in name.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty()) {
        if !words.is_empty() {
            words.push('_');
        }
        words.push_str(word);
    }
    let identifier = match words.chars().next() {
        Some(first) if first.is_ascii_alphabetic() => words,
        Some(_) => format!("filter_{words}"),
        None => "filter".to_owned(),
    };
    let end = identifier.len().min(LONGEST);
    identifier[..end].trim_end_matches('_').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_name_becomes_an_identifier() {
        for (name, identifier) in [
            ("bilateral", "bilateral"),
            ("tamis-2", "tamis_2"),
            ("2017", "filter_2017"),
            ("", "filter"),
            ("*/ é \n", "filter"),
            ("__a__b__", "a_b"),
            ("a\\\nb", "a_b"),
        ] {
            assert_eq!(of(name), identifier, "{name:?}");
        }
        assert_eq!(of(&"long ".repeat(1000)), "long_long_long_long_long_long_long_long");
    }
}
