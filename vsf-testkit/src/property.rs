use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// Runs a check. Its panic is given the names of the part and of the property.
pub(crate) fn ask(who: &str, property: &str, check: impl FnOnce()) {
    let Err(cause) = catch_unwind(AssertUnwindSafe(check)) else {
        return;
    };
    let text = (cause.downcast_ref::<String>().map(String::as_str))
        .or_else(|| cause.downcast_ref::<&str>().copied());
    match text {
        Some(text) => panic!("{who}: {property}: {text}"),
        None => resume_unwind(cause),
    }
}
