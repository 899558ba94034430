//! Files made by hand, files written here, files with every byte changed, and the Khronos validator's own broken ones.

use nalgebra::{Matrix4, UnitQuaternion, Vector3};
use serde_json::{Value as Json, json};

use super::container::to_base64;
use super::*;
use crate::algo::skeleton::Joint;

/// A file of one triangle of the points (0,0,0), (1,0,0), (0,1,0) and what else is put into it.
struct File {
    json: Json,
    bytes: Vec<u8>,
}

impl File {
    fn new() -> Self {
        let mut file = Self {
            json: json!({
                "asset": { "version": "2.0" }, "accessors": [], "bufferViews": [],
                "nodes": [{ "name": "thing", "mesh": 0 }], "meshes": [{ "primitives": [{ "attributes": {} }] }],
            }),
            bytes: Vec::new(),
        };
        let position = file.floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], "VEC3");
        file.primitive()["attributes"]["POSITION"] = position.into();
        file
    }

    fn primitive(&mut self) -> &mut Json {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        let view = json!({ "buffer": 0, "byteOffset": self.bytes.len(), "byteLength": bytes.len() });
        self.bytes.extend_from_slice(bytes);
        let views = self.json["bufferViews"].as_array_mut().unwrap();
        views.push(view);
        views.len() - 1
    }

    fn accessor(&mut self, bytes: &[u8], kind: u32, shape: &str, count: usize) -> usize {
        let view = self.view(bytes);
        let accessors = self.json["accessors"].as_array_mut().unwrap();
        accessors.push(json!({ "bufferView": view, "componentType": kind, "count": count, "type": shape }));
        accessors.len() - 1
    }

    fn floats(&mut self, numbers: &[f32], shape: &str) -> usize {
        let width = match shape {
            "SCALAR" => 1,
            "MAT4" => 16,
            vector => vector[3..].parse().unwrap(),
        };
        let bytes: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(&bytes, 5126, shape, numbers.len() / width)
    }

    fn open(&self) -> Result<Document, GltfError> {
        let mut json = self.json.clone();
        let uri = format!("data:application/octet-stream;base64,{}", to_base64(&self.bytes));
        json["buffers"] = json!([{ "byteLength": self.bytes.len(), "uri": uri }]);
        opened(json.to_string().as_bytes())
    }

    fn character(&self) -> Result<Character, GltfError> {
        let document = self.open()?;
        document.character(&document.rig()?, None, None)
    }

    fn refused(&self) -> String {
        self.character().unwrap_err().to_string()
    }
}

fn opened(bytes: &[u8]) -> Result<Document, GltfError> {
    Document::open(bytes, &mut |path| Err(format!("{path}: expected no file")))
}

#[test]
fn a_thing_without_a_skin_hangs_on_a_joint_of_its_own() {
    let mut file = File::new();
    file.json["nodes"] = json!([{ "children": [1], "translation": [0, 2, 0] }, { "name": "thing", "mesh": 0, "scale": [2, 2, 2] }]);
    let document = file.open().unwrap();
    let rig = document.rig().unwrap();
    assert_eq!((&rig.parents[..], &rig.names[..]), (&[-1, 0][..], &["node 0".to_owned(), "thing".to_owned()][..]));
    let thing = document.character(&rig, None, None).unwrap();
    assert_eq!(
        (&thing.triangles[..], &thing.joints[..4], &thing.weights[..4]),
        (&[[0, 1, 2]][..], &[1, 1, 1, 1][..], &[1.0, 0.0, 0.0, 0.0][..])
    );
    assert_eq!((rig.rest[1].scale, &rig.inverse_bind[..]), (Vector3::repeat(2.0), &[Matrix4::identity(); 2][..]));
}

#[test]
fn strips_and_fans_are_triangles_of_one_winding() {
    let mut file = File::new();
    let more = file.floats(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0], "VEC3");
    file.primitive()["attributes"]["POSITION"] = more.into();
    file.primitive()["mode"] = 5.into();
    assert_eq!(file.character().unwrap().triangles, [[0, 1, 2], [2, 1, 3]]);
    file.primitive()["mode"] = 6.into();
    assert_eq!(file.character().unwrap().triangles, [[0, 1, 2], [0, 2, 3]]);
    let indices = file.accessor(&[0, 1, 2, 2, 3, 3], 5121, "SCALAR", 6);
    file.primitive()["indices"] = indices.into();
    file.primitive()["mode"] = 5.into();
    assert_eq!(file.character().unwrap().triangles, [[0, 1, 2]], "those without area are left out");
    file.primitive()["mode"] = 1.into();
    assert_eq!(file.refused(), "expected triangles in the meshes of the file, found meshes[0].primitives[0] with lines (mode 1)");
    file.json["meshes"][0]["primitives"] = json!([{ "mode": 0, "attributes": {} }, { "attributes": {} }]);
    let found = "found meshes[0].primitives[0] with points (mode 0), meshes[0].primitives[1] with no POSITION";
    assert_eq!(file.refused(), format!("expected triangles in the meshes of the file, {found}"));
    file.json["nodes"] = json!([{}]);
    assert_eq!(file.refused(), "expected triangles in the meshes of the file, found no mesh in its scene");
}

#[test]
fn integers_stand_for_fractions_where_they_say_so() {
    let mut file = File::new();
    let uvs = file.accessor(&[0, 255, 51, 0, 255, 102, 0, 0], 5121, "VEC2", 3);
    file.json["accessors"][uvs]["normalized"] = true.into();
    file.primitive()["attributes"]["TEXCOORD_0"] = uvs.into();
    assert_eq!(file.character().unwrap().uvs, [[0.0, 1.0], [0.2, 0.0], [1.0, 0.4]]);
    let bytes: Vec<u8> = [-32768i16, -32767, 32767, 0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let signed = file.accessor(&bytes, 5122, "VEC4", 1);
    file.json["accessors"][signed]["normalized"] = true.into();
    assert_eq!(file.open().unwrap().numbers(signed, &["VEC4"], super::accessor::REAL, "x").unwrap(), [-1.0, -1.0, 1.0, 0.0]);
}

#[test]
fn sparse_accessors_change_what_they_stand_on() {
    let mut file = File::new();
    let (places, values) =
        (file.view(&[0, 2]), file.view(&[5f32, 6.0, 7.0, 8.0, 9.0, 10.0].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>()));
    let sparse = json!({ "count": 2, "indices": { "bufferView": places, "componentType": 5121 }, "values": { "bufferView": values } });
    file.json["accessors"][0]["sparse"] = sparse.clone();
    assert_eq!(file.character().unwrap().positions, [[5.0, 6.0, 7.0], [1.0, 0.0, 0.0], [8.0, 9.0, 10.0]]);
    // Without bytes of its own an accessor is nought.
    file.json["accessors"][0] = json!({ "componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse });
    assert_eq!(file.character().unwrap().positions[1], [0.0; 3]);
    file.json["accessors"][0]["count"] = 2.into();
    assert_eq!(file.refused(), "accessors[0].sparse: expected an element below 2, found 2");
}

#[test]
fn any_number_of_joints_move_a_vertex() {
    let mut file = File::new();
    file.json["nodes"] = json!([{ "name": "thing", "mesh": 0, "skin": 0 }, { "name": "a", "children": [2] }, { "name": "b" }]);
    file.json["skins"] = json!([{ "joints": [2, 1] }]);
    for set in 0..2 {
        let joints = file.accessor(&[0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1], 5121, "VEC4", 3);
        let weights = file.floats(&[0.125; 12], "VEC4");
        file.primitive()["attributes"][format!("JOINTS_{set}")] = joints.into();
        file.primitive()["attributes"][format!("WEIGHTS_{set}")] = weights.into();
    }
    let document = file.open().unwrap();
    let rig = document.rig().unwrap();
    let thing = document.character(&rig, None, None).unwrap();
    assert_eq!(rig.names, ["a", "b"]);
    assert_eq!((thing.influences, &thing.joints[..8]), (8, &[1, 0, 1, 0, 1, 0, 1, 0][..]));
    assert_eq!(thing.weights, [0.125; 24]);
    file.json["skins"][0]["joints"] = json!([2]);
    assert!(file.refused().ends_with("vertex 0: expected joints below 1, found 1"), "{}", file.refused());
}

#[test]
fn skins_that_bind_a_joint_in_two_ways_have_two_joints() {
    let mut file = File::new();
    let moved = Matrix4::new_translation(&Vector3::new(1.0f32, 2.0, 3.0));
    let matrices = file.floats(moved.as_slice(), "MAT4");
    file.json["nodes"] = json!([{ "name": "thing", "mesh": 0, "skin": 0 }, { "name": "a" }, { "mesh": 0, "skin": 1 }]);
    file.json["skins"] = json!([{ "joints": [1] }, { "joints": [1], "inverseBindMatrices": matrices }]);
    let joints = file.accessor(&[0; 12], 5121, "VEC4", 3);
    let weights = file.floats(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], "VEC4");
    file.primitive()["attributes"]["JOINTS_0"] = joints.into();
    file.primitive()["attributes"]["WEIGHTS_0"] = weights.into();
    let document = file.open().unwrap();
    let rig = document.rig().unwrap();
    assert_eq!((&rig.parents[..], &rig.names[1]), (&[-1, 0][..], &"a (2)".to_owned()));
    assert_eq!((rig.inverse_bind[0], rig.inverse_bind[1]), (Matrix4::identity(), moved.cast()));
    assert_eq!(document.character(&rig, None, None).unwrap().joints[12], 1);
}

#[test]
fn base_colours_are_vertex_colours_and_textures_lie_as_they_are_told() {
    let mut file = File::new();
    let own = file.accessor(&[255, 0, 0, 128, 0, 255, 0, 255, 255, 255, 255, 0], 5121, "VEC4", 3);
    file.json["accessors"][own]["normalized"] = true.into();
    file.primitive()["attributes"]["COLOR_0"] = own.into();
    file.primitive()["material"] = 0.into();
    let uvs = file.floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0], "VEC2");
    file.primitive()["attributes"]["TEXCOORD_1"] = uvs.into();
    let transform = json!({ "offset": [0.5, 0.25], "rotation": std::f64::consts::FRAC_PI_2, "scale": [2.0, 4.0], "texCoord": 1 });
    file.json["materials"] = json!([{ "name": "m", "pbrMetallicRoughness": {
        "baseColorFactor": [0.5, 1.0, 1.0, 0.5],
        "baseColorTexture": { "index": 0, "extensions": { "KHR_texture_transform": transform } } } }]);
    file.json["textures"] = json!([{ "source": 0 }]);
    let thing = file.character().unwrap();
    let alpha = 128.0 / 255.0 * 0.5;
    assert_eq!((thing.colors[0], thing.colors[2]), ([0.5 * alpha, 0.0, 0.0, alpha], [0.0; 4]));
    let rounded: Vec<[f64; 2]> = thing.uvs.iter().map(|uv| uv.map(|v| (v * 1e12).round() / 1e12)).collect();
    assert_eq!(rounded, [[0.5, 0.25], [0.5, -1.75], [4.5, 0.25]]);
    assert_eq!(thing.parts, [Part { image: Some(0), vertices: 0..3 }]);
    let document = file.open().unwrap();
    let rig = document.rig().unwrap();
    assert!(document.character(&rig, None, Some(&[Pick::Name("m".to_owned())])).is_ok());
    let error = document.character(&rig, None, Some(&[Pick::Name("n".to_owned())])).unwrap_err();
    assert_eq!(error.to_string(), "expected a material of the file, found \"n\"; there are \"m\"");
    let error = document.character(&rig, Some(&[Pick::Index(4)]), None).unwrap_err();
    assert_eq!(error.to_string(), "expected a mesh of the file, found number 4; there are \"thing\"");
}

/// A file whose node moves by one sampler.
fn moving(path: &str, interpolation: &str, times: &[f32], values: &[f32], shape: &str) -> File {
    let mut file = File::new();
    let (input, output) = (file.floats(times, "SCALAR"), file.floats(values, shape));
    file.json["animations"] = json!([{ "name": "go",
        "samplers": [{ "input": input, "output": output, "interpolation": interpolation }],
        "channels": [{ "sampler": 0, "target": { "node": 0, "path": path } }] }]);
    file
}

fn at(file: &File, seconds: f64) -> Joint {
    let document = file.open().unwrap();
    document.sample(None).unwrap().pose(&document.rig().unwrap(), seconds)[0]
}

#[test]
fn keys_are_joined_in_steps_straight_and_by_splines() {
    let straight = moving("translation", "LINEAR", &[1.0, 3.0], &[0.0, 0.0, 0.0, 4.0, 2.0, 0.0], "VEC3");
    let x = |file: &File, t: f64| at(file, t).translation.x;
    assert_eq!([0.0, 1.5, 2.0, 9.0].map(|t| x(&straight, t)), [0.0, 1.0, 2.0, 4.0]);
    let steps = moving("translation", "STEP", &[1.0, 3.0], &[0.0, 0.0, 0.0, 4.0, 2.0, 0.0], "VEC3");
    assert_eq!([1.0, 2.9, 3.0].map(|t| x(&steps, t)), [0.0, 0.0, 4.0]);
    // x = t³ from 1 to 3: values 1 and 27, slopes 3 and 27.
    let keys = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 3.0, 0.0, 0.0, 27.0, 0.0, 0.0, 27.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let spline = moving("translation", "CUBICSPLINE", &[1.0, 3.0], &keys, "VEC3");
    for t in [1.0, 1.3, 2.0, 2.75, 3.0] {
        assert!((x(&spline, t) - t * t * t).abs() < 1e-12, "{t}");
    }
    // A turn by the shorter way at constant speed, its keys on opposite sides of the sphere.
    let (a, b) = (UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.2f32), UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 1.4f32));
    let keys: Vec<f32> = a.coords.iter().copied().chain(b.coords.iter().map(|v| -v)).collect();
    let turn = moving("rotation", "LINEAR", &[0.0, 1.0], &keys, "VEC4");
    for t in [0.0, 0.25, 0.8, 1.0] {
        let found = at(&turn, t).rotation;
        let truth = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.2 + 1.2 * t);
        assert!(found.angle_to(&truth) < 1e-7, "{t}: {found} {truth}");
    }
}

#[test]
fn keys_that_make_no_sense_are_refused() {
    let refused = |file: File| file.open().unwrap().sample(None).err().unwrap().to_string();
    let three = [0.0; 9];
    let cases = [
        (
            moving("translation", "LINEAR", &[1.0, 1.0, 2.0], &three, "VEC3"),
            "animations[0].samplers[0]: key 1: expected times that ascend, found 1 after 1",
        ),
        (moving("translation", "LINEAR", &[0.0, 1.0], &three, "VEC3"), "animations[0].samplers[0]: expected 6 numbers for 2 keys, found 9"),
        (moving("translation", "LINEAR", &[], &[], "VEC3"), "animations[0].samplers[0]: expected a key at least, found none"),
        (
            moving("translation", "LINEAR", &[0.0, f32::NAN], &[0.0; 6], "VEC3"),
            "animations[0].samplers[0]: key 1: expected a finite time, found NaN",
        ),
        (
            moving("scale", "LINEAR", &[0.0, 1.0], &[1.0, 1.0, 1.0, 1.0, f32::NAN, 1.0], "VEC3"),
            "animations[0].samplers[0]: key 1: expected finite numbers, found NaN",
        ),
        (
            moving("rotation", "LINEAR", &[0.0, 1.0], &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0], "VEC4"),
            "animations[0].samplers[0]: key 1: expected a unit quaternion, found one without length",
        ),
        (
            moving("rotation", "CUBICSPLINE", &[0.0], &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], "VEC4"),
            "animations[0].samplers[0]: key 0: expected a unit quaternion, found one without length",
        ),
        (
            moving("colour", "STEP", &[0.0], &three, "VEC3"),
            "animations[0].channels[0].target: expected the path translation, rotation, scale or weights, found \"colour\"",
        ),
        (
            moving("translation", "EASE", &[0.0], &three, "VEC3"),
            "animations[0].samplers[0]: expected LINEAR, STEP or CUBICSPLINE, found \"EASE\"",
        ),
        (moving("rotation", "STEP", &[0.0], &three, "VEC3"), "accessors[2]: expected the type VEC4, found \"VEC3\""),
    ];
    cases.into_iter().for_each(|(file, message)| assert_eq!(refused(file), message));
    // Tangents may be nought, and what KHR_animation_pointer moves is passed over.
    let spline = moving("rotation", "CUBICSPLINE", &[0.0], &[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0], "VEC4");
    assert!(spline.open().unwrap().sample(None).is_ok());
    assert!(moving("pointer", "STEP", &[0.0], &three, "VEC3").open().unwrap().sample(None).is_ok());
    let file = moving("translation", "STEP", &[0.0], &[0.0; 3], "VEC3");
    let error = file.open().unwrap().sample(Some(&[Pick::Name("gone".to_owned())])).err().unwrap();
    assert_eq!(error.to_string(), "expected an animation of the file, found \"gone\"; there are \"go\"");
}

#[test]
fn what_reaches_beyond_its_bytes_is_refused_and_allocates_nothing() {
    let with = |change: &dyn Fn(&mut Json)| {
        let mut file = File::new();
        change(&mut file.json);
        file.refused()
    };
    let far = "accessors[0]: expected 4000000000 elements of 12 bytes, found a buffer view of 36 bytes";
    assert_eq!(with(&|j| j["accessors"][0]["count"] = 4_000_000_000u64.into()), far);
    let empty = json!({ "componentType": 5126, "count": 1u64 << 60, "type": "VEC3" });
    assert!(with(&|j| j["accessors"][0] = empty.clone()).contains("expected a file of at most 268435456 numbers"));
    assert_eq!(
        with(&|j| j["bufferViews"][0]["byteLength"] = u64::MAX.into()),
        format!("bufferViews[0]: expected bytes within a buffer of 36, found {} from 0", u64::MAX)
    );
    assert_eq!(with(&|j| j["bufferViews"][0]["byteStride"] = 8.into()), "accessors[0]: expected a byteStride of 12 at least, found 8");
    let offset = with(&|j| j["accessors"][0]["byteOffset"] = u64::MAX.into());
    assert_eq!(offset, "accessors[0]: expected 3 elements of 12 bytes, found a buffer view of 36 bytes");
    assert_eq!(
        with(&|j| j["accessors"][0]["componentType"] = 5124.into()),
        "accessors[0]: expected a componentType of 5120, 5121, 5122, 5123, 5126, found 5124"
    );
    let wrong = with(&|j| j["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 9.into());
    assert_eq!(wrong, "meshes[0].primitives[0]: expected one of 1 accessors, found number 9");
}

#[test]
fn nodes_that_are_each_others_children_are_refused() {
    let with = |nodes: Json| {
        let mut file = File::new();
        file.json["nodes"] = nodes;
        file.refused()
    };
    assert!(
        with(json!([{ "mesh": 0, "children": [1] }, { "children": [0] }]))
            .starts_with("nodes: joint 0: expected parents that lead to a root")
    );
    assert_eq!(with(json!([{ "mesh": 0, "children": [3] }])), "nodes[0].children: expected one of 1 nodes, found number 3");
    let two = with(json!([{ "mesh": 0, "children": [2] }, { "children": [2] }, {}]));
    assert_eq!(two, "nodes[1].children: expected one parent for each node, found two for node 2");
    let sheared = with(json!([{ "mesh": 0, "matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] }]));
    assert_eq!(sheared, "nodes[0].matrix: expected a translation, rotation and scale, found another matrix");
}

#[test]
fn numbers_of_a_type_that_they_cannot_have_are_refused() {
    let with = |attribute: &str, kind: u32| {
        let mut file = File::new();
        let own = file.accessor(&[0; 48], kind, if attribute == "indices" { "SCALAR" } else { "VEC3" }, 3);
        match attribute {
            "indices" => file.primitive()["indices"] = own.into(),
            _ => file.primitive()["attributes"][attribute] = own.into(),
        }
        file.refused()
    };
    let measured = "accessors[1]: expected a componentType of 5120, 5121, 5122, 5123, 5126, found 5125";
    assert_eq!((with("POSITION", 5125), with("NORMAL", 5125)), (measured.to_owned(), measured.to_owned()));
    assert_eq!(with("indices", 5126), "accessors[1]: expected a componentType of 5121, 5123, 5125, found 5126");
    let mut file = moving("translation", "STEP", &[0.0], &[0.0; 3], "VEC3");
    file.json["accessors"][1]["componentType"] = 5125.into();
    let error = file.open().unwrap().sample(None).err().unwrap().to_string();
    assert_eq!(error, "accessors[1]: expected a componentType of 5126, found 5125");
}

#[test]
fn sparse_elements_that_do_not_ascend_are_refused() {
    for (places, message) in [([2, 0], "found 0 after 2"), ([1, 1], "found 1 after 1")] {
        let mut file = File::new();
        let (places, values) = (file.view(&places), file.view(&[0; 24]));
        file.json["accessors"][0]["sparse"] =
            json!({ "count": 2, "indices": { "bufferView": places, "componentType": 5121 }, "values": { "bufferView": values } });
        assert_eq!(file.refused(), format!("accessors[0].sparse.indices: expected indices that ascend, {message}"));
        file.json["accessors"][0]["sparse"]["indices"]["componentType"] = 5126.into();
        assert_eq!(file.refused(), "accessors[0].sparse.indices: expected a componentType of 5121, 5123, 5125, found 5126");
    }
}

/// A file whose three vertices hang on two joints with these weights.
fn skinned(weights: &[f32; 12]) -> File {
    let mut file = File::new();
    file.json["nodes"] = json!([{ "name": "thing", "mesh": 0, "skin": 0 }, { "name": "a", "children": [2] }, { "name": "b" }]);
    file.json["skins"] = json!([{ "joints": [1, 2] }]);
    let joints = file.accessor(&[0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0], 5121, "VEC4", 3);
    let weights = file.floats(weights, "VEC4");
    file.primitive()["attributes"]["JOINTS_0"] = joints.into();
    file.primitive()["attributes"]["WEIGHTS_0"] = weights.into();
    file
}

#[test]
fn skins_that_bind_to_what_there_is_not_are_refused() {
    let good = [1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0, 0.25, 0.25, 0.0, 0.0];
    assert!(skinned(&good).character().is_ok());
    let with = |change: &dyn Fn(&mut Json)| {
        let mut file = skinned(&good);
        change(&mut file.json);
        file.refused()
    };
    let out = "skins[0].skeleton: expected one of 3 nodes, found number 9";
    assert_eq!(with(&|j| j["skins"][0]["skeleton"] = 9.into()), out);
    assert_eq!(with(&|j| j["skins"][0]["joints"] = json!([1, 1])), "skins[0].joints: expected each joint once, found node 1 twice");
    assert_eq!(
        with(&|j| j["nodes"][2]["rotation"] = json!([0, 0, 0, 0])),
        "nodes[2].rotation: expected a unit quaternion, found one without length"
    );
    let outside = "skins[0].joints: expected joints in the scene of the mesh, found node 1 outside of it";
    assert_eq!(with(&|j| j["scenes"] = json!([{ "nodes": [0] }])), outside);
    let mut whole = skinned(&good);
    let shares = whole.accessor(&[255; 12], 5121, "VEC4", 3);
    whole.primitive()["attributes"]["WEIGHTS_0"] = shares.into();
    let integers = "expected weights as numbers with a point or as normalized integers, found integers that are not normalized";
    assert_eq!(whole.refused(), format!("accessors[{shares}]: {integers}"));
    whole.json["accessors"][shares]["normalized"] = true.into();
    assert!(whole.character().is_ok());
    let mut slanted = skinned(&good);
    let identity: [f32; 16] = std::array::from_fn(|k| if k % 5 == 0 { 1.0 } else { 0.0 });
    let matrices: Vec<f32> =
        identity.into_iter().chain(std::array::from_fn::<f32, 16, _>(|k| identity[k] + if k == 7 { 0.5 } else { 0.0 })).collect();
    slanted.json["skins"][0]["inverseBindMatrices"] = slanted.floats(&matrices, "MAT4").into();
    let row = "skins[0]: expected inverse bind matrix 1 to end in the row 0, 0, 0, 1, found [0.0, 0.5, 0.0, 1.0]";
    assert_eq!(slanted.refused(), row);
    let far = "nodes[1]: expected finite numbers of 32 bits in its place, found 1e308";
    assert_eq!(with(&|j| j["nodes"][1]["scale"] = json!([1e308, 1, 1])), far);
    assert_eq!(with(&|j| j["nodes"][1]["translation"] = json!([1, 1e308, 1])), far);
    let mut none = good;
    none[4..8].fill(0.0);
    assert_eq!(skinned(&none).character().unwrap().weights[4..8], [0.0; 4], "valid, and left to who skins it");
    none[4..6].copy_from_slice(&[2.0, -1.0]);
    assert_eq!(skinned(&none).refused(), "meshes[0].primitives[0]: vertex 1: expected weights of 0 and above, found -1");
}

/// A figure of two joints with all that can be written.
fn figure(binary: bool) -> Vec<u8> {
    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.25, 1.5, -0.5]];
    let joint = |x: f64, angle: f64| Joint {
        translation: Vector3::new(x, 0.5, 0.0),
        rotation: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle),
        scale: Vector3::new(1.0, 2.0, 1.0),
    };
    let poses: Vec<Vec<Joint>> = (0..5).map(|k| vec![joint(0.0, 0.0), joint(1.0, 0.1 * f64::from(k))]).collect();
    let weights: Vec<Vec<f64>> = (0..5).map(|k| vec![0.25 * f64::from(k / 2), 1.0]).collect();
    let target = |name: &str, y: f64| Target { name: name.to_owned(), positions: vec![[0.0, y, 0.0]; 4], normals: vec![[0.0; 3]; 4] };
    let export = Export {
        name: "figure",
        text: Some(("made_by", "hand")),
        surface: Surface {
            positions: &positions,
            triangles: &[[0, 1, 2], [2, 1, 3]],
            uvs: &[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 0.5]],
            normals: &[[0.0, 0.0, 1.0]; 4],
            colors: &[[0.5, 0.25, 0.0, 1.0]; 4],
        },
        skin: Some(Skin {
            influences: 2,
            joints: &[0, 1, 0, 1, 1, 1, 0, 0],
            weights: &[1.0, 0.0, 0.5, 0.5, 0.75, 0.5, 0.0, 0.0],
            inverse_bind: &[Matrix4::identity(), Matrix4::new_translation(&Vector3::new(-1.0, 0.0, 0.0))],
            parents: &[-1, 0],
            rest: &[joint(0.0, 0.0), joint(1.0, 0.0)],
            names: &["upper".to_owned(), "lower".to_owned()],
        }),
        targets: &[target("smile", 0.125), target("frown", -0.5)],
        animated: Animated { fps: 24.0, poses: &poses, weights: &weights, steps: [false, true] },
        texture: None,
        binary,
    };
    write(&export).unwrap()
}

#[test]
fn what_is_written_is_read_again() {
    for binary in [false, true] {
        assert_eq!(super::text(&figure(binary), "made_by").as_deref(), Some("hand"));
        let document = opened(&figure(binary)).unwrap();
        let rig = document.rig().unwrap();
        let figure = document.character(&rig, None, None).unwrap();
        // One joint stands for what nothing moves, and one for all roots, as a skin has one.
        assert_eq!(rig.names, ["roots", "upper", "lower", "unmoved"]);
        // What is above the bones is no bone: it stays unbound.
        assert_eq!((rig.inverse_bind[0], rig.skins[0].len()), (Matrix4::identity(), 3));
        let names: Vec<&str> = figure.joints.chunks_exact(4).map(|j| rig.names[j[0] as usize].as_str()).collect();
        assert_eq!(names, ["upper", "upper", "lower", "unmoved"]);
        assert_eq!(figure.weights[..8], [1.0, 0.0, 0.0, 0.0, 0.5, 0.5, 0.0, 0.0]);
        assert_eq!((figure.positions[3], figure.uvs[3], figure.colors[0]), ([0.25, 1.5, -0.5], [0.5; 2], [0.5, 0.25, 0.0, 1.0]));
        assert_eq!(
            (&figure.target_names[..], figure.target_positions[5]),
            (&["smile".to_owned(), "frown".to_owned()][..], [0.0, -0.5, 0.0])
        );
        let sample = document.sample(None).unwrap();
        assert_eq!(sample.duration(), f64::from(4.0f32 / 24.0));
        let lower = sample.pose(&rig, 2.5 / 24.0)[2];
        assert!((lower.rotation.angle() - 0.25).abs() < 1e-6 && lower.scale.y == 2.0, "{lower:?}");
        // The third drawing holds from its key on.
        assert_eq!(figure.target_weights(&sample, 3.9 / 24.0).unwrap(), [0.25, 1.0]);
        assert_eq!(figure.target_weights(&sample, 4.1 / 24.0).unwrap(), [0.5, 1.0]);
    }
}

#[test]
fn what_cannot_be_written_is_refused() {
    let export = Export {
        name: "x",
        surface: Surface::default(),
        skin: None,
        targets: &[],
        animated: Animated::default(),
        texture: None,
        binary: true,
        text: None,
    };
    assert_eq!(write(&export).unwrap_err().to_string(), "mesh: expected triangles, found none");
    let surface =
        Surface { positions: &[[0.0; 3], [1.0, f64::NAN, 0.0], [1e300, 0.0, 0.0]], triangles: &[[0, 1, 2]], ..Surface::default() };
    let error = write(&Export { surface, ..export }).unwrap_err().to_string();
    assert_eq!(error, "positions: element 1: expected a finite number, found NaN");
}

/// Reads all that there is to read.
fn read_all(bytes: &[u8]) -> Result<(), GltfError> {
    let document = opened(bytes)?;
    let rig = document.rig()?;
    let sample = document.sample(None)?;
    let character = document.character(&rig, None, None)?;
    sample.pose(&rig, 0.1);
    character.target_weights(&sample, 0.1)?;
    Ok(())
}

#[test]
fn a_file_with_any_byte_changed_or_cut_is_an_error_or_a_character() {
    for binary in [false, true] {
        let whole = figure(binary);
        read_all(&whole).unwrap();
        let mut refused = 0;
        for i in 0..whole.len() {
            for change in [1u8, 0x80, 0x7f] {
                let mut bytes = whole.clone();
                bytes[i] ^= change;
                refused += usize::from(read_all(&bytes).is_err());
            }
        }
        refused += (0..whole.len()).filter(|n| read_all(&whole[..*n]).is_err()).count();
        assert!(refused > whole.len(), "{refused} of {}", 4 * whole.len());
    }
}

/// The folder of other people's files; none where it does not lie next to the project.
fn shared(name: &str) -> Option<std::path::PathBuf> {
    let folder = std::path::PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")).join(name);
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: there is no folder {}", folder.display());
    None
}

#[test]
fn broken_files_of_the_validator_are_refused() {
    let Some(folder) = shared("hostile/gltf_validator") else { return };
    let (mut tried, mut passed) = (0, Vec::new());
    for part in ["glb", "node", "skin", "skin_data"] {
        let mut files: Vec<_> = std::fs::read_dir(folder.join(part)).unwrap().map(|f| f.unwrap().path()).collect();
        files.sort();
        for file in files.iter().filter(|f| f.extension().is_some_and(|e| e == "glb" || e == "gltf")) {
            let report = std::fs::read_to_string(format!("{}.report.json", file.display())).unwrap();
            let report: Json = serde_json::from_str(&report).unwrap();
            let read = opened(&std::fs::read(file).unwrap()).and_then(|d| d.rig().map(|_| d));
            tried += 1;
            if read.is_ok() && report["issues"]["numErrors"] != 0 {
                passed.push(file.file_stem().unwrap().to_string_lossy().into_owned());
            }
        }
    }
    // What is left breaks a rule without a doubt about what is meant, or where nothing hangs on it.
    let harmless = [
        "chunk_too_big",
        "unaligned_chunk",
        "empty_array",
        "empty_children_array",
        "matrix_trs",
        "node_loop_scene",
        "node_skin_without_skinned_mesh",
        "node_weights_invalid",
        "rotation_non_unit",
        "skin_with_no_mesh",
        "unresolved_camera",
        "unresolved_mesh",
        "unresolved_skin",
        "weights_with_no_mesh",
        "buffer_view_bytestride",
        "empty_joints_array",
        "empty_object",
        "no_common_root",
        "no_joints_in_scene",
        "skeleton_invalid",
        "invalid_ibm",
        "misplaced_bin_chunk",
        "matrix_indecomposable",
    ];
    passed.retain(|name| !harmless.contains(&name.as_str()));
    assert!(tried > 60 && passed.is_empty(), "{tried} files; read without an error: {passed:?}");
}
