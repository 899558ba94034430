//! What a call of a plugin costs, in this process and in a worker: a node that does next to nothing, and a filter of a picture in full HD.
//!
//! Both ways take turns, and the least of each counts, which other programs on the machine disturb least. The allocator is the program's, so that pictures
//! lie where workers see them.

use std::error::Error;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pegbar_engine::Value;
use pegbar_engine::array::NdArray;
use pegbar_engine::clock::Clock;
use pegbar_engine::node::{Arg, Cancel, Context};
use pegbar_engine::plugin::{ENDING, Isolation, LibraryFile, Manifest, describe, digest, find, platform, serve_if_asked};
use pegbar_engine::registry::{NodeType, Registry};
use pegbar_engine::value::{ValueRef, Vector};

#[allow(dead_code, unreachable_pub, unused_imports, reason = "the program's own file, of which this uses the allocator alone")]
#[path = "../../src/pool.rs"]
mod pool;

#[global_allocator]
static POOL: pool::Pool = pool::Pool;

/// A picture.
#[derive(Clone, Debug, Value)]
struct Clip {
    /// Samples.
    #[value(shape = "[c, h, w]")]
    planes: NdArray<f32, 3>,
}

fn build(folder: &Path) -> Result<std::path::PathBuf, Box<dyn Error>> {
    let library = folder.join("libbench.so");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut cc = Command::new(std::env::var_os("CC").unwrap_or_else(|| "cc".into()));
    cc.args(["-std=c11", "-shared", "-fPIC", "-O2", "-I"]).arg(root.join("../plugins/include")).arg("-o").arg(&library);
    if !cc.arg(root.join("benches/plugins.c")).status()?.success() {
        return Err("expected a C compiler".into());
    }
    let plugin = describe(&library)?;
    let libraries = [(platform(), LibraryFile { file: "libbench.so".to_owned(), digest: digest(&library)? })].into();
    let path = folder.join(format!("{}{ENDING}", plugin.name));
    Manifest { libraries, plugin }.write(&path)?;
    Ok(path)
}

fn node(manifest: &Path, isolation: Isolation, id: &str) -> Result<NodeType, Box<dyn Error>> {
    let mut registry = Registry::new().value::<Clip>().with_isolation(isolation);
    find(manifest).remove(0)?.register(&mut registry)?;
    Ok(registry.get(id).ok_or("expected the node")?.clone())
}

/// The time of `count` tasks, each.
fn time(node: &NodeType, value: &ValueRef, count: u32) -> Result<Duration, Box<dyn Error>> {
    let clock = Clock { name: "frames".to_owned(), first: 1, last: 1, fps: (24, 1) };
    let cancel = Cancel::default();
    let cx = Context { frame: 1, clock: &clock, input_clocks: &[], cancel: &cancel };
    let began = Instant::now();
    for _ in 0..count {
        node.operator.compute(vec![Arg::Value(value.clone())], None, &cx)?;
    }
    Ok(began.elapsed() / count)
}

fn main() -> Result<(), Box<dyn Error>> {
    serve_if_asked();
    let folder = tempfile::tempdir()?;
    let manifest = build(folder.path())?;
    let numbers: ValueRef = Arc::new(Vector { values: vec![1.0, 2.0] });
    let ways = |id: &str| -> Result<[NodeType; 2], Box<dyn Error>> {
        Ok([node(&manifest, Isolation::Off, id)?, node(&manifest, Isolation::Auto, id)?])
    };
    let least = |id: &str, value: &ValueRef, count: u32, rounds: u32| -> Result<[Duration; 2], Box<dyn Error>> {
        let nodes = ways(id)?;
        let mut least = [Duration::MAX; 2];
        for _ in 0..rounds {
            for (least, node) in least.iter_mut().zip(&nodes) {
                *least = (*least).min(time(node, value, count)?);
            }
        }
        Ok(least)
    };
    let [here, there] = least("bench.next", &numbers, 100, 60)?;
    println!("call of a node in C      in process {here:>10.2?}   isolated {there:>10.2?}");
    // After the first node the memory that is shared is there.
    let data = (0..4 * 1080 * 1920).map(|i| (i % 1000) as f32 / 500.0).collect();
    let clip = Clip { planes: NdArray::new([4, 1080, 1920], data).ok_or("expected a picture")? };
    let picture: ValueRef = Arc::new(clip);
    let [here, there] = least("bench.filter", &picture, 1, 60)?;
    let more = 100.0 * (there.as_secs_f64() / here.as_secs_f64() - 1.0);
    println!("filter of 1920x1080x4    in process {here:>10.2?}   isolated {there:>10.2?}   {more:+.1} %");
    Ok(())
}
