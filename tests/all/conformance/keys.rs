//! Whatever is changed at any node changes its key: a result is never taken for another.

use std::collections::BTreeSet;
use std::path::Path;

use pegbar_engine::exec::{Options, execute};
use pegbar_engine::graph::{Graph, Port};
use pegbar_engine::key::Keys;
use pegbar_engine::node::{InputSchema, NodeSchema};
use pegbar_engine::plan::{Known, Plan, Planned, Target, plan};
use pegbar_engine::registry::Registry;
use pegbar_engine::stamp::Files;
use pegbar_nodes::registry;

use super::standin::{Kind, check, fields, literals, reference, text, write_all};
use crate::support::collect::complaints;

/// The plan of the node `x`, where need be with values that decide what is read.
fn planned(graph: &Graph) -> Result<Plan, String> {
    let node = graph.find("x").unwrap();
    let mut known = Known::new();
    loop {
        match plan(graph, &[Target { node, frames: None }], &[], known.clone()).map_err(|e| e.error.message)? {
            Planned::Ready(plan) => return Ok(plan),
            Planned::First(ports) => {
                let mut report = execute(graph, &[], &ports, &Options::default()).map_err(|e| e.error.message)?;
                for port in ports {
                    let value = report.kept.remove(&port).and_then(|v| v.into_iter().next().flatten());
                    known.insert(port, value.ok_or_else(|| format!("{} was not made", graph.port_name(port)))?);
                }
            }
        }
    }
}

/// The keys of all outputs of `x` at all frames.
fn keys(graph: &Graph) -> Result<BTreeSet<[u8; 32]>, String> {
    let plan = planned(graph)?;
    let keys = Keys::of(graph, &plan, &Files::new(None)).map_err(|e| e.error.message)?;
    let node = graph.find("x").unwrap();
    let mut found = BTreeSet::new();
    for output in 0..graph.nodes[node].ty.schema.outputs.len().max(1) {
        let port = Port { node, output };
        let values = if graph.is_single(port) { 1 } else { graph.nodes[node].clock.len() };
        found.extend((0..values).map(|index| keys.value(node, output, index)));
    }
    Ok(found)
}

/// Two pictures a frame, two drawings of the same nodes, two characters, two takes in either format, and two files of markers.
pub(super) fn pictures(folder: &Path) {
    for (name, x) in [("a", 3), ("b", 5)] {
        let write = |extension: &str, text: String| std::fs::write(folder.join(format!("{name}.{extension}")), text).unwrap();
        let channels = "CHANNELS 3 Xposition Yposition Zrotation";
        write(
            "bvh",
            format!("HIERARCHY ROOT {name}\n{{ OFFSET 0 {x} 0 {channels} }}\nMOTION\nFrames: 2\nFrame Time: 0.04\n0 0 0\n1 {x} 30\n"),
        );
        write("asf", format!(":root\norder TX RX\nposition {x} 0 0\n"));
        write("amc", format!("1\nroot {x} 0\n2\nroot 1 {x}\n"));
        write(
            "csv",
            (1..=4)
                .map(|frame| format!("{frame},R,{frame},{x}\r\n{frame},G,{x},1\r\n"))
                .fold("frame,name,x,y\r\n".to_owned(), |a, b| a + &b),
        );
    }
    for (name, x) in [("a", 3), ("b", 5)] {
        let drawing =
            format!("<svg xmlns='http://www.w3.org/2000/svg' width='12' height='9'><g id='a'><path id='b' d='M0 0L{x} 0L2 7Z'/></g></svg>");
        std::fs::write(folder.join(format!("{name}.svg")), drawing).unwrap();
    }
    for (name, target) in [("a", "smile"), ("b", "frown")] {
        use pegbar_nodes::algo::gltf;
        let target = gltf::Target { name: target.to_owned(), positions: vec![[0.0, 0.5, 0.0]; 3], ..gltf::Target::default() };
        let surface = gltf::Surface {
            positions: &[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            triangles: &[[0, 1, 2]],
            ..gltf::Surface::default()
        };
        let animated = gltf::Animated { fps: 24.0, weights: &[vec![0.0], vec![1.0]], ..gltf::Animated::default() };
        let export = gltf::Export { name, surface, skin: None, targets: &[target], animated, texture: None, binary: false, text: None };
        std::fs::write(folder.join(format!("{name}.gltf")), gltf::write(&export).unwrap()).unwrap();
    }
    for (name, level) in [("a", 0.2), ("b", 0.7)] {
        for frame in 1..=4 {
            let picture =
                pegbar_nodes::algo::codec::Picture::new(vec![level + frame as f32 * 0.05; 2 * 2 * 3], 2, 2, &["R", "G", "B"]).unwrap();
            let options = pegbar_nodes::algo::codec::EncodeOptions::new(pegbar_nodes::algo::codec::Format::Png);
            let bytes = pegbar_nodes::algo::codec::encode_to_vec(&picture, &options).unwrap();
            std::fs::write(folder.join(format!("{name}.{frame:04}.png")), bytes).unwrap();
        }
    }
}

/// The fields of the node with `input` given as `value`.
fn with(base: &[(String, String)], input: &InputSchema, value: &str) -> Vec<(String, String)> {
    let mut fields: Vec<_> = base.iter().filter(|(name, _)| name != input.name).cloned().collect();
    fields.push((input.name.to_owned(), value.to_owned()));
    fields
}

/// What may stand at the input in place of what does.
fn others(schema: &NodeSchema, input: &InputSchema) -> Vec<String> {
    match reference(schema, input, Kind::Other) {
        Some(reference) => vec![reference],
        None => literals(schema, input).into_iter().rev().collect(),
    }
}

/// How one input fares: `Ok` where another value gives other keys throughout.
fn examine(folder: &Path, registry: &Registry, schema: &NodeSchema, base: &[(String, String)], input: &InputSchema) -> Result<(), String> {
    if input.choices.len() == 1 {
        // The one choice that there is can be no other.
        return Ok(());
    }
    let before = check(folder, &text(schema.id, base), registry);
    let before = keys(before.graph.as_ref().ok_or_else(|| complaints(&before))?)?;
    let mut refused = String::new();
    for value in others(schema, input) {
        let stands = base.iter().find(|(n, _)| n == input.name).map(|(_, v)| v.as_str()).or(input.default);
        if stands.is_some_and(|s| s.trim_matches('"') == value.trim_matches('"')) {
            continue;
        }
        let loaded = check(folder, &text(schema.id, &with(base, input, &value)), registry);
        let Some(graph) = &loaded.graph else {
            refused = complaints(&loaded);
            continue;
        };
        // A value may be refused only when frames are asked for: a reference frame that there is not.
        let after = match keys(graph) {
            Ok(keys) => keys,
            Err(why) => {
                refused = why;
                continue;
            }
        };
        let same = after.intersection(&before).count();
        return if same == 0 { Ok(()) } else { Err(format!("= {value}: expected other keys, found {same} that are the same")) };
    }
    Err(format!("expected another value that it takes, found none; say one in conformance/standin.rs\n{refused}"))
}

#[test]
fn whatever_is_changed_changes_the_key() {
    let folder = tempfile::tempdir().unwrap();
    let registry = registry();
    write_all(folder.path(), &registry, Kind::Ordinary);
    write_all(folder.path(), &registry, Kind::Other);
    pictures(folder.path());
    let mut wrong = Vec::new();
    let mut tried = 0;
    for node in registry.nodes() {
        let base = fields(&node.schema, |_| Kind::Ordinary);
        for input in &node.schema.inputs {
            tried += 1;
            if let Err(why) = examine(folder.path(), &registry, &node.schema, &base, input) {
                wrong.push(format!("{} {} {why}", node.schema.id, input.name));
            }
        }
    }
    assert!(tried > 150, "{tried} inputs");
    super::none(&wrong);
}
