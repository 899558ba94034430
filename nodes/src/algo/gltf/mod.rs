//! glTF 2.0: characters read from and written to `.gltf` and `.glb`.
//!
//! Read: triangles, strips and fans; skins with any number of influences; rigid parts, which hang on joints of their own; morph targets; animations in
//! steps, straight and as cubic splines; sparse and normalised accessors; data URIs, files beside the file, binary containers; base colours, their
//! textures and texture transforms. Nothing is believed before it is held against the bytes that are there, so that no file makes the reader panic or
//! allocate more than a small multiple of its length and [`LARGEST`].
//!
//! **Source** Khronos Group, *glTF 2.0 Specification*, 2021; extensions KHR_mesh_quantization and KHR_texture_transform.

mod accessor;
mod animation;
mod character;
mod container;
mod error;
mod json;
mod rig;
mod write;

#[cfg(test)]
mod tests;

pub use animation::Sample;
pub use character::{Character, Part};
pub use error::GltfError;
pub use rig::Rig;
pub use write::{Animated, Export, Skin, Surface, Target, write};

use std::cell::Cell;

use error::{item, malformed};

/// Most numbers that one file may unfold to: 2 GiB of them.
pub const LARGEST: usize = 1 << 28;

/// Extensions that a file may require. Those that change how a surface shines do not change what is read.
const KNOWN: [&str; 3] = ["KHR_mesh_quantization", "KHR_texture_transform", "KHR_lights_punctual"];

/// Which of several, as a graph file names it.
#[derive(Clone, Debug, PartialEq)]
pub enum Pick {
    /// By its name.
    Name(String),
    /// By its place, from 0.
    Index(usize),
}

impl std::fmt::Display for Pick {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Pick::Name(name) => write!(f, "{name:?}"),
            Pick::Index(index) => write!(f, "number {index}"),
        }
    }
}

impl Pick {
    fn is(&self, index: usize, name: Option<&str>) -> bool {
        match self {
            Pick::Name(wanted) => Some(wanted.as_str()) == name,
            Pick::Index(wanted) => *wanted == index,
        }
    }
}

/// An opened file, its buffers at hand.
pub struct Document {
    root: json::Root,
    buffers: Vec<Vec<u8>>,
    left: Cell<usize>,
}

impl Document {
    /// Opens a file's bytes. `read` gives the bytes of a file beside it.
    ///
    /// # Errors
    /// Where the file is damaged, requires an extension that is not known, or a buffer cannot be read or is too short.
    pub fn open(bytes: &[u8], read: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<Self, GltfError> {
        let (text, bin) = container::open(bytes)?;
        let root: json::Root = serde_json::from_slice(text).map_err(|e| malformed("json", e.to_string()))?;
        match &root.asset {
            Some(asset) if asset.version.split('.').next() == Some("2") => {}
            Some(asset) => return Err(malformed("asset.version", format!("expected 2.0, found {:?}", asset.version))),
            None => return Err(malformed("asset", "expected the asset's version, found none")),
        }
        let unknown = root.extensions_required.iter().find(|e| !KNOWN.contains(&e.as_str()) && !e.starts_with("KHR_materials_"));
        if let Some(name) = unknown {
            let message = format!("expected a file that can be read without {name}, found it required");
            return Err(GltfError::Unsupported { at: "extensionsRequired".to_owned(), message });
        }
        let mut buffers = Vec::new();
        for (i, buffer) in root.buffers.iter().enumerate() {
            let at = format!("buffers[{i}]");
            let bytes = match &buffer.uri {
                Some(uri) => fetch(uri, &at, read)?,
                // The first buffer of a binary container is its binary chunk.
                None => bin.filter(|_| i == 0).map(<[u8]>::to_vec).unwrap_or_default(),
            };
            if bytes.len() < buffer.byte_length {
                return Err(malformed(at, format!("expected {} bytes, found {}", buffer.byte_length, bytes.len())));
            }
            buffers.push(bytes);
        }
        Ok(Self { root, buffers, left: Cell::new(LARGEST) })
    }

    /// The encoded bytes of an image.
    ///
    /// # Errors
    /// Where there is no such image, or it cannot be read.
    pub fn image(&self, index: usize, read: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<Vec<u8>, GltfError> {
        let image = item(&self.root.images, "images", index, "images")?;
        let at = format!("images[{index}]");
        match (&image.uri, image.buffer_view) {
            (Some(uri), _) => fetch(uri, &at, read),
            (None, Some(view)) => Ok(self.view(view, &at)?.0.to_vec()),
            (None, None) => Err(malformed(at, "expected a uri or a bufferView, found neither")),
        }
    }

    /// The files that the JSON of a file names, relative to it; none where it cannot be read.
    pub fn beside(bytes: &[u8]) -> Vec<String> {
        let json = container::open(bytes).ok().and_then(|(text, _)| serde_json::from_slice::<json::Root>(text).ok());
        let Some(root) = json else { return Vec::new() };
        let uris = root.buffers.iter().filter_map(|b| b.uri.as_ref()).chain(root.images.iter().filter_map(|i| i.uri.as_ref()));
        let file = |uri: &String| match container::uri(uri, "") {
            Ok(container::Uri::File(path)) => Some(path),
            _ => None,
        };
        uris.filter(|u| !u.starts_with("data:")).filter_map(file).collect()
    }

    /// Takes so many numbers from what the file may unfold to.
    fn spend(&self, numbers: usize, at: &str) -> Result<(), GltfError> {
        let left = self.left.get().checked_sub(numbers).ok_or_else(|| GltfError::TooLarge {
            at: at.to_owned(),
            message: format!("expected a file of at most {LARGEST} numbers, found {numbers} more"),
        })?;
        self.left.set(left);
        Ok(())
    }
}

fn fetch(uri: &str, at: &str, read: &mut dyn FnMut(&str) -> Result<Vec<u8>, String>) -> Result<Vec<u8>, GltfError> {
    match container::uri(uri, at)? {
        container::Uri::Data(bytes) => Ok(bytes),
        container::Uri::File(path) => read(&path).map_err(GltfError::File),
    }
}

/// Some names, for messages.
fn listed<'a>(names: impl Iterator<Item = Option<&'a str>>) -> String {
    let names: Vec<String> = names.enumerate().map(|(i, n)| n.map_or_else(|| i.to_string(), |n| format!("{n:?}"))).collect();
    match names.len() {
        0 => "none".to_owned(),
        n if n > 30 => format!("{} and {} more", names[..30].join(", "), n - 30),
        _ => names.join(", "),
    }
}

/// The text under `name` in a file, where there is one: what [`Export::text`] put there.
pub fn text(bytes: &[u8], name: &str) -> Option<String> {
    let (json, _) = container::open(bytes).ok()?;
    let root: serde_json::Value = serde_json::from_slice(json).ok()?;
    root.pointer("/asset/extras")?.get(name)?.as_str().map(str::to_owned)
}
