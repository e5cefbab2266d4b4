//! The slow, plain, independent reference that the library is tested against.
//!
//! Nothing here shares code with the library but its public types: matrices are nested vectors, products are loops,
//! every linear or quadratic program goes to Clarabel through [`program`], which checks each answer itself.

// Each test binary uses its own part of the support.
#![allow(dead_code)]

pub mod cases;
pub mod linear;
pub mod program;
pub mod random;
pub mod reference;

/// Runs a check on every item and fails with all of the failures, so that one does not hide the others.
pub fn every<T>(items: impl IntoIterator<Item = T>, check: impl Fn(T)) {
    let mut failures = Vec::new();
    let mut count = 0;
    for item in items {
        count += 1;
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| check(item)));
        if let Err(cause) = result {
            failures.push(match cause.downcast_ref::<String>() {
                Some(message) => message.clone(),
                None => cause.downcast_ref::<&str>().unwrap_or(&"?").to_string(),
            });
        }
    }
    assert!(
        failures.is_empty(),
        "{} of {count} failed:\n{}",
        failures.len(),
        failures.join("\n")
    );
}
