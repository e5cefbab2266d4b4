//! Ctrl-C: a search ends with what it knows; everything else ends at once.

use crate::failure::Class;
use crate::output::note;
use std::sync::atomic::{AtomicBool, Ordering};

/// Ctrl-C was pressed during a search.
static ASKED: AtomicBool = AtomicBool::new(false);
/// A search is running.
static SEARCHING: AtomicBool = AtomicBool::new(false);

/// Takes Ctrl-C over. Where the system does not allow it, Ctrl-C ends the command as it always does.
pub fn install() {
    let _ = ctrlc::set_handler(|| {
        if !SEARCHING.load(Ordering::SeqCst) || ASKED.swap(true, Ordering::SeqCst) {
            std::process::exit(i32::from(Class::Interrupted as u8));
        }
        note("stopping; press Ctrl-C again to end at once");
    });
}

/// While this lives, the first Ctrl-C only asks the search to end.
pub struct Search;

impl Search {
    pub fn begin() -> Self {
        SEARCHING.store(true, Ordering::SeqCst);
        Self
    }

    /// Whether the search was asked to end.
    pub fn is_asked_to_end() -> bool {
        ASKED.load(Ordering::SeqCst)
    }
}

impl Drop for Search {
    fn drop(&mut self) {
        SEARCHING.store(false, Ordering::SeqCst);
    }
}
