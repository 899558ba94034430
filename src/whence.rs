//! `pegbar whence`: how a written file was made.

use std::io::Write;
use std::path::{Component, Path, PathBuf};

use pegbar_engine::atomic;
use pegbar_engine::origin::{KEY, Origin};
use pegbar_nodes::algo::{codec, gltf};

use crate::args::{Format, WhenceArgs};
use crate::console::{Console, EXIT_FAILED, EXIT_OK, EXIT_WRONG, count};

pub(crate) fn whence(args: &WhenceArgs, console: &mut Console) -> u8 {
    let bytes = match std::fs::read(&args.file) {
        Ok(bytes) => bytes,
        Err(error) => {
            console.say(&format!("error: {}: {error}\n", args.file.display()));
            return EXIT_WRONG;
        }
    };
    let text = codec::text(&bytes, KEY).or_else(|| gltf::text(&bytes, KEY));
    let Some(origin) = text.and_then(|text| serde_json::from_str::<Origin>(&text).ok()) else {
        let message = "expected a PNG, OpenEXR or glTF file that a graph wrote, found none of its making in it";
        console.say(&format!("error: {}: {message}\n", args.file.display()));
        return EXIT_FAILED;
    };
    if let Some(folder) = &args.extract {
        return extract(&origin, folder, console);
    }
    match args.format {
        Format::Json => console.json(&origin),
        Format::Text => {
            console.out(&describe(&origin));
            EXIT_OK
        }
    }
}

/// The command that made the file, and the text of its graph.
fn describe(origin: &Origin) -> String {
    let quoted = |text: &str| {
        if text.chars().all(|c| c.is_ascii_alphanumeric() || "._-/=#".contains(c)) {
            text.to_owned()
        } else {
            format!("'{}'", text.replace('\'', "'\\''"))
        }
    };
    let pairs = |flag: &'static str, list: &[(String, String)]| {
        list.iter().map(|(k, v)| format!(" {flag} {}", quoted(&format!("{k}={v}")))).collect::<String>()
    };
    let folder = |flag: &'static str, path: &String| format!(" {flag} {}", quoted(path));
    let layers = origin.site.iter().map(|s| folder("--site", s)).chain(origin.shot.iter().map(|s| folder("--shot", s)));
    let layers: String = layers.chain(origin.library.iter().map(|l| folder("--library", l))).collect();
    let settings = [pairs("--var", &origin.variables), pairs("--set", &origin.overrides)].concat();
    let mut out = format!("// pegbar {}: pegbar run {}{layers}{settings}\n", origin.pegbar, quoted(&origin.graph));
    let others = origin.files.keys().filter(|name| **name != origin.graph).map(String::as_str).collect::<Vec<_>>();
    if !others.is_empty() {
        out.push_str(&format!("// with {}; `--extract DIR` writes them\n", others.join(", ")));
    }
    out + origin.files.get(&origin.graph).map_or("", String::as_str)
}

/// Writes the graph and what it used below a folder, as they lay to each other.
fn extract(origin: &Origin, folder: &Path, console: &mut Console) -> u8 {
    let up = |name: &String| Path::new(name).components().take_while(|c| *c == Component::ParentDir).count();
    let deepest = origin.files.keys().map(up).max().unwrap_or(0);
    // The graph lies so deep that no name leads out of the folder.
    let base: PathBuf = (0..deepest).map(|_| "graph").collect();
    for (name, text) in &origin.files {
        let mut path = base.clone();
        for part in Path::new(name).components() {
            match part {
                Component::ParentDir => drop(path.pop()),
                Component::Normal(part) => path.push(part),
                _ => (),
            }
        }
        let path = folder.join(path);
        let made = path.parent().map_or(Ok(()), std::fs::create_dir_all).map_err(|e| e.to_string());
        let written = made.and_then(|()| atomic::write(&path, |out| out.write_all(text.as_bytes())).map_err(|e| e.to_string()));
        if let Err(error) = written {
            console.say(&format!("error: {}: {error}\n", path.display()));
            return EXIT_WRONG;
        }
        console.out(&format!("{}\n", path.display()));
    }
    console.say(&format!("{}; run {}\n", count(origin.files.len(), "file"), folder.join(base).join(&origin.graph).display()));
    EXIT_OK
}
