//! Any text: it is an expression, which printing and parsing gives back, or an error
//! that points into the text.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tamis::expr::text::latex;
use tamis::expr::{Sort, Tree};

fuzz_target!(|text: &str| {
    match text.parse::<Tree>() {
        Ok(tree) => {
            let printed = tree.to_string();
            let again: Tree = printed.parse().expect("what is printed can be parsed");
            assert_eq!(again, tree, "{printed}");
            assert!(!latex(&tree).is_empty());
            if tree.sort() == Sort::Scalar {
                let weight = tree.meaning(|_, _| 0.25);
                assert!(weight.is_finite(), "{printed} means {weight}");
            }
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
});
