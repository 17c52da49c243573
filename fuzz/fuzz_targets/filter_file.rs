//! Any filter file: it is a filter, which writing and reading gives back, or an error
//! that names the file.
#![no_main]

use std::path::Path;

use libfuzzer_sys::fuzz_target;
use tamis::filter::Filter;

fuzz_target!(|text: &str| {
    let path = Path::new("fuzzed.toml");
    match Filter::parse(text, path) {
        Ok(filter) => {
            let written = filter.to_toml(toml::Table::new());
            let again = Filter::parse(&written, path).expect("what is written can be read");
            assert_eq!(again, filter, "{written}");
        }
        Err(error) => assert!(error.to_string().contains("fuzzed.toml"), "{error}"),
    }
});
