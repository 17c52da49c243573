//! Texts that C hands in, and texts that it gets.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::ffi::{CStr, CString, c_char};
use std::ptr;

use crate::error::Failure;

/// How many of the texts that it was given a thread keeps: enough for all that one expression asks
/// for.
const KEPT: usize = 16;

thread_local! {
    /// What the thread was given last. A thread owns its texts, so that they outlive the devices
    /// and filters that they tell of, and no other thread can take them away.
    static GIVEN: RefCell<VecDeque<CString>> = const { RefCell::new(VecDeque::new()) };
}

/// Reads a text. `what` is what messages call it.
///
/// # Safety
/// `text` is NULL, or points to a text that ends with a zero byte and that nobody changes until
/// this function returns.
pub(crate) unsafe fn read(text: *const c_char, what: &str) -> Result<String, Failure> {
    if text.is_null() {
        return Err(Failure::argument(format!("{what} is NULL; it must be a text")));
    }
    // SAFETY: it is not NULL, and the caller promises the rest.
    let text = unsafe { CStr::from_ptr(text) };
    let text = text.to_str().map_err(|error| {
        Failure::argument(format!("{what} is not UTF-8 from byte {} on", error.valid_up_to()))
    })?;
    Ok(text.to_owned())
}

/// A text for C. It stays until this thread was given [`KEPT`] others, or ends.
pub(crate) fn give(text: &str) -> *const c_char {
    let text = for_c(text);
    // A text's bytes stay where they are when the text is moved.
    let given = GIVEN.try_with(|given| {
        let mut given = given.borrow_mut();
        given.truncate(KEPT - 1);
        let start = text.as_ptr();
        given.push_front(text);
        start
    });
    // A thread that ends has no place for a text any more.
    given.unwrap_or(ptr::null())
}

/// A text as C has them. They end at their first zero, and what files are called may hold any
/// character: zeros are left out.
pub(crate) fn for_c(text: &str) -> CString {
    let bytes: Vec<u8> = text.bytes().filter(|&byte| byte != 0).collect();
    CString::new(bytes).expect("no zero is left")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::types::TAMIS_ERROR_INVALID_ARGUMENT;

    #[test]
    fn texts_are_read_and_given() {
        let read = |text: Option<&CStr>| {
            // SAFETY: NULL, or a text that outlives the call.
            unsafe { read(text.map_or(ptr::null(), CStr::as_ptr), "the name") }
        };
        assert_eq!(read(Some(c"color")).expect("a text"), "color");
        for (wrong, said) in [(None, "the name is NULL"), (Some(c"ab\xff"), "from byte 2 on")] {
            let failure = read(wrong).unwrap_err();
            assert_eq!(failure.code, TAMIS_ERROR_INVALID_ARGUMENT);
            assert!(failure.message.contains(said), "{failure:?}");
        }
        let first = give("a\0b");
        let others: Vec<*const c_char> = (1..KEPT).map(|k| give(&k.to_string())).collect();
        // SAFETY: they were given to this thread, and no more than it keeps.
        let texts = unsafe { [first, others[KEPT - 2]].map(|text| CStr::from_ptr(text)) };
        assert_eq!(texts, [c"ab", c"15"]);
    }
}
