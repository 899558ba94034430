//! Motion in the style of drawings.

mod assemble;
mod find;
#[cfg(test)]
mod tests;

pub(crate) use assemble::StyleAssemble;
pub(crate) use find::StyleFind;
