//! Plugins for Pegbar in Rust. A node is a struct, as the built-in ones are; [`export!`] makes a plugin of several. The crate is a `cdylib`.
//!
//! ```
//! use pegbar_plugin::prelude::*;
//! use pegbar_plugin::types::Image;
//!
//! /// Brightens a picture.
//! #[derive(Node)]
//! #[node(id = "bright.gain", version = 1, outputs = Outputs)]
//! struct Gain {
//!     /// The picture.
//!     image: In<Image>,
//!     /// Factor; 0 is black, 1 the picture itself.
//!     #[input(default = 1.2, range = 0.0..=8.0)]
//!     gain: f64,
//! }
//!
//! /// What it makes.
//! #[derive(Outputs)]
//! struct Outputs {
//!     /// The brighter picture.
//!     image: Image,
//! }
//!
//! impl PerFrame for Gain {
//!     fn run(self, _cx: &Context) -> Result<Outputs, NodeError> {
//!         Ok(Outputs { image: self.image.map(|sample| sample * self.gain as f32)? })
//!     }
//! }
//!
//! pegbar_plugin::export! { name: "bright", doc: "Brightens pictures.", per_frame: [Gain], values: [Image] }
//! # fn main() {}
//! ```
//!
//! A type of values is declared with the arrays and texts that it has in the host, by name; a plugin whose declaration is another is refused. Large arrays
//! are [`Buffer`](array::Buffer)s: they are read where the host has them, and a new one lies where the host wants it. `pegbar plugin manifest LIBRARY`
//! writes the manifest.

mod border;
pub mod types;

pub use pegbar_engine::{Node, Outputs, Setting, Value};
pub use pegbar_engine::{array, clock, node, setting, value};

#[doc(hidden)]
pub use border::{Exports, entry};
#[doc(hidden)]
pub use pegbar_abi as abi;
#[doc(hidden)]
pub use pegbar_engine::plugin::Threads;
#[doc(hidden)]
pub use pegbar_engine::registry::Registry;

/// What a node file needs.
pub mod prelude {
    pub use crate::array::Buffer;
    pub use crate::node::{Context, Frames, In, List, NodeError, PerFrame, Recurrent, Sequence, Stream, Whole};
    pub use crate::{Node, Outputs, Setting, Value};
}

/// Makes a plugin of nodes and the value types that they read and make. Stands at the root of the crate:
///
/// `export! { name: "grain", doc: "Paper and film.", threads: any, per_frame: [...], recurrent: [...], whole: [...], values: [...] }`, of which all but name and
/// doc may be left out. The plugin's version is that of its package.
#[macro_export]
macro_rules! export {
    (
        name: $name:literal, doc: $doc:literal
        $(, threads: $threads:ident)?
        $(, per_frame: [$($per_frame:ty),* $(,)?])?
        $(, recurrent: [$($recurrent:ty),* $(,)?])?
        $(, whole: [$($whole:ty),* $(,)?])?
        $(, values: [$($value:ty),* $(,)?])?
        $(,)?
    ) => {
        extern crate pegbar_plugin as pegbar_engine;

        /// The plugin's entry point.
        ///
        /// # Safety
        /// Called by a host, as the ABI says.
        #[allow(unsafe_code, reason = "the one symbol of the plugin's ABI")]
        #[unsafe(no_mangle)]
        pub unsafe extern "C" fn pb_plugin_entry(host: *const $crate::abi::PbHost) -> *const $crate::abi::PbPlugin {
            static EXPORTS: ::std::sync::OnceLock<$crate::Exports> = ::std::sync::OnceLock::new();
            #[allow(unused_mut, unused_assignments, reason = "a plugin that says nothing of threads")]
            let make = || {
                let mut threads = "any";
                $(threads = stringify!($threads);)?
                let registry = $crate::Registry::new()
                    $($(.value::<$value>())*)?
                    $($(.per_frame::<$per_frame>())*)?
                    $($(.recurrent::<$recurrent>())*)?
                    $($(.whole::<$whole>())*)?;
                $crate::Exports::new($name, env!("CARGO_PKG_VERSION"), $doc, threads, registry)
            };
            // SAFETY: the host keeps to the ABI.
            unsafe { $crate::entry(host, &EXPORTS, make) }
        }
    };
}
