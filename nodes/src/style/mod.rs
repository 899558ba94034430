//! Motion in the style of drawings.

mod assemble;
#[cfg(test)]
mod tests;

pub(crate) use assemble::StyleAssemble;
