//! What is read of a glTF file's JSON. Names are those of the specification.

use serde::Deserialize;

macro_rules! object {
    ($(#[$about:meta])* $name:ident { $($(#[$attribute:meta])* $field:ident: $ty:ty),* $(,)? }) => {
        $(#[$about])*
        #[derive(Clone, Debug, Default, Deserialize)]
        #[serde(rename_all = "camelCase", default)]
        pub(super) struct $name { $($(#[$attribute])* pub(super) $field: $ty),* }
    };
}

object! {
    /// The whole file.
    Root {
        asset: Option<Asset>,
        extensions_required: Vec<String>,
        scene: Option<usize>,
        scenes: Vec<Scene>,
        nodes: Vec<Node>,
        meshes: Vec<Mesh>,
        skins: Vec<Skin>,
        animations: Vec<Animation>,
        materials: Vec<Material>,
        textures: Vec<Texture>,
        images: Vec<Image>,
        accessors: Vec<Accessor>,
        buffer_views: Vec<BufferView>,
        buffers: Vec<Buffer>,
    }
}
object! { Asset { version: String } }
object! { Scene { nodes: Vec<usize> } }
object! {
    Node {
        name: Option<String>,
        children: Vec<usize>,
        mesh: Option<usize>,
        skin: Option<usize>,
        matrix: Option<[f64; 16]>,
        translation: Option<[f64; 3]>,
        rotation: Option<[f64; 4]>,
        scale: Option<[f64; 3]>,
        weights: Option<Vec<f64>>,
    }
}
object! { Mesh { name: Option<String>, primitives: Vec<Primitive>, weights: Option<Vec<f64>>, extras: serde_json::Value } }
object! {
    Primitive {
        attributes: std::collections::BTreeMap<String, usize>,
        indices: Option<usize>,
        material: Option<usize>,
        mode: Option<u32>,
        targets: Vec<std::collections::BTreeMap<String, usize>>,
    }
}
object! { Skin { inverse_bind_matrices: Option<usize>, joints: Vec<usize>, skeleton: Option<usize> } }
object! { Animation { name: Option<String>, channels: Vec<Channel>, samplers: Vec<Sampler> } }
object! { Channel { sampler: usize, target: Target } }
object! { Target { node: Option<usize>, path: String } }
object! { Sampler { input: usize, output: usize, interpolation: Option<String> } }
object! { Material { name: Option<String>, pbr_metallic_roughness: Pbr } }
object! { Pbr { base_color_factor: Option<[f64; 4]>, base_color_texture: Option<TextureInfo> } }
object! { TextureInfo { index: usize, tex_coord: u32, extensions: Extensions } }
object! { Extensions { #[serde(rename = "KHR_texture_transform")] transform: Option<TextureTransform> } }
object! { TextureTransform { offset: [f64; 2], rotation: f64, scale: Option<[f64; 2]>, tex_coord: Option<u32> } }
object! { Texture { source: Option<usize> } }
object! { Image { uri: Option<String>, buffer_view: Option<usize> } }
object! {
    Accessor {
        buffer_view: Option<usize>,
        byte_offset: usize,
        component_type: u32,
        normalized: bool,
        count: usize,
        #[serde(rename = "type")]
        shape: String,
        sparse: Option<Sparse>,
    }
}
object! { Sparse { count: usize, indices: SparseIndices, values: SparseValues } }
object! { SparseIndices { buffer_view: usize, byte_offset: usize, component_type: u32 } }
object! { SparseValues { buffer_view: usize, byte_offset: usize } }
object! { BufferView { buffer: usize, byte_offset: usize, byte_length: usize, byte_stride: Option<usize> } }
object! { Buffer { uri: Option<String>, byte_length: usize } }
