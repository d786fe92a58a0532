//! A diagnosis for people: in words, on the terminal, and as a page.

mod page;
mod sentence;
mod text;
mod torques;
mod words;

pub use page::{page, page_of_report};
pub use text::text;
pub use words::plain;
