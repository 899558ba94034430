//! An example of a plugin in Rust: paper and ink. A picture filter, a node that remembers, one that sees the whole shot, and a value type of its own.

mod bleed;
mod exposure;
mod flicker;
mod grain;
mod trail;

use pegbar_plugin::types::Image;

pegbar_plugin::export! {
    name: "paper",
    doc: "Paper and ink: grain, bleeding ink, trails of earlier drawings, and an even exposure.",
    per_frame: [bleed::PaperBleed, flicker::PaperFlicker, grain::PaperGrain],
    recurrent: [trail::PaperTrail],
    whole: [exposure::PaperExposure],
    values: [Image, exposure::Exposure],
}
