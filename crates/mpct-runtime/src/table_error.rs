//! Why tables or memory were refused.

/// Why tables were refused.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TableError {
    /// A slice has the wrong length.
    Length {
        /// Which slice.
        what: &'static str,
        /// Length asked for.
        expected: usize,
        /// Length found.
        found: usize,
    },
    /// A dimension is zero that must not be, or the sizes overflow.
    Dimensions,
    /// An entry is NaN or infinite.
    NotFinite {
        /// Which slice.
        what: &'static str,
        /// Position in it.
        index: usize,
    },
    /// The Hessian is not positive definite: elimination met a pivot that is not positive.
    NotPositiveDefinite {
        /// Which pivot.
        index: usize,
        /// Its value.
        pivot: f64,
    },
    /// A row scale is not a positive power of two, or a bound of movement is smaller than its row: damaged tables.
    Damaged {
        /// Which row.
        row: usize,
    },
    /// A window leaves its matrix, or does not stand where the format wants it.
    Window {
        /// Which row.
        row: usize,
    },
    /// An order names what does not exist, or not everything.
    Order {
        /// Which order.
        what: &'static str,
        /// Position in it.
        index: usize,
    },
    /// A shift map names a row that does not exist.
    Shift {
        /// Position in the map.
        row: usize,
        /// What it says.
        found: u32,
    },
}

impl core::fmt::Display for TableError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match *self {
            Self::Length {
                what,
                expected,
                found,
            } => write!(f, "{what} has length {found}, expected {expected}"),
            Self::Dimensions => write!(f, "a dimension is zero or too large"),
            Self::NotFinite { what, index } => write!(f, "{what}[{index}] is not finite"),
            Self::NotPositiveDefinite { index, pivot } => {
                write!(
                    f,
                    "the Hessian is not positive definite: pivot {index} is {pivot:e}"
                )
            }
            Self::Damaged { row } => write!(f, "the tables of row {row} contradict each other"),
            Self::Window { row } => write!(f, "the window of row {row} does not fit its matrix"),
            Self::Order { what, index } => write!(f, "{what} is wrong at entry {index}"),
            Self::Shift { row, found } => write!(
                f,
                "the shift map sends row {row} to {found}, which does not exist"
            ),
        }
    }
}

impl core::error::Error for TableError {}
