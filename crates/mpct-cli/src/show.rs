//! Shows a file to a person, where there is a screen.

use crate::output::note;
use std::path::Path;

/// Whether this machine has a screen to show a page on; if not, why.
pub fn shows_pages() -> Result<(), &'static str> {
    let set = |name: &str| std::env::var_os(name).is_some_and(|v| !v.is_empty());
    let needs_display = cfg!(all(unix, not(target_os = "macos")));
    // Windows' own programs are reached from its Linux without a display.
    if !needs_display
        || ["DISPLAY", "WAYLAND_DISPLAY", "WSL_DISTRO_NAME"]
            .into_iter()
            .any(set)
    {
        Ok(())
    } else {
        Err("no screen here (neither DISPLAY nor WAYLAND_DISPLAY is set)")
    }
}

/// Opens a file with the program that is registered for it. Where none starts, a message says so.
pub fn show_page(path: &Path) {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_path_buf());
    if let Err(error) = open::that_detached(&full) {
        note(&format!(
            "no program for web pages was started ({error}); the report is {}",
            path.display()
        ));
    }
}
