//! Floor 7: what people get to see: tables, pictures, pages.
//!
//! Text is made here, and written elsewhere: a report is a value that a command
//! prints or saves. Numbers are formatted in [`number`] and nowhere else, so
//! that a figure reads the same in a table, a log line and a page.

pub mod caption;
pub mod chart;
pub mod contrast;
mod findings;
mod form;
pub mod graph;
pub mod number;
pub mod page;
pub mod picture;
pub mod score;
pub mod sheet;
pub mod table;
pub mod tradeoff;

pub use contrast::{Contrast, FIGURES, Figure, Figures, common_window};
pub use findings::Findings;
pub use form::{Form, UnknownForm};
pub use picture::Picture;
pub use score::{Measured, Score, ScoreTable, Total};
pub use table::{Align, Format, Table};
pub use tradeoff::{Entry, Ground, Outcome, Tradeoff};
