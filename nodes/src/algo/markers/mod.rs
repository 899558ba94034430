//! Markers on the joints of a figure: their standard names, how rigs of many makers call those joints, files of them, and their smoothing.

pub mod naming;
pub mod smooth;
pub mod standard;
pub mod table;

#[cfg(test)]
mod tests;
