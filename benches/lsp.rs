//! How long `pegbar lsp` takes to answer on a graph of a thousand nodes, as an editor meets it: over pipes, by its own program.
//!
//! Each row is one kind of request; before each a character is typed, so that nothing of the answer before counts. The median and the
//! greatest of a few dozen, in milliseconds, and the least, which other programs on the machine disturb least.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::time::Instant;

use pegbar_engine::check::{LoadOptions, load_text};
use serde_json::{Value, json};

type Bad = Box<dyn std::error::Error>;

const NODES: usize = 1000;
const ROUNDS: usize = 30;

/// What 1,000 nodes are.
#[derive(Clone, Copy, Debug)]
enum Shape {
    /// Pictures over pictures, each with settings.
    Plain,
    /// A hundred uses of a graph of nine nodes, and what joins them.
    Nested,
    /// As plain, with a slip in every tenth node.
    Broken,
}

/// A node of a chain of pictures.
fn node(i: usize, shape: Shape) -> String {
    let (a, b) = ((i - 1) / 2, i - 1);
    let ty = match (shape, i % 3) {
        (Shape::Broken, _) if i.is_multiple_of(10) => format!("(type: \"comp.over\", fg: \"@m{a}\", bg: \"@n{b}\")"),
        (_, 0) => format!("(type: \"comp.over\", fg: \"@n{a}\", bg: \"@n{b}\", opacity: 0.5)"),
        (_, 1) => format!("(type: \"image.blur\", image: \"@n{b}\", size: (2.0, 3.0), kernel: box, outside: clamp)"),
        (_, _) => format!("(type: \"comp.merge\", fg: \"@n{a}\", bg: \"@n{b}\", operation: plus)"),
    };
    format!("        // Step {i}.\n        \"n{i}\": {ty},\n")
}

fn chain(count: usize, shape: Shape) -> String {
    (1..count).map(|i| node(i, shape)).collect()
}

fn graph(params: &str, nodes: &str, last: &str) -> String {
    let head = "Graph(\n    pegbar: 1,\n    frames: (first: 1, last: 48, fps: 24),\n";
    format!("{head}    params: {{{params}}},\n    nodes: {{\n{nodes}    }},\n    outputs: {{ \"image\": \"@{last}\" }},\n)\n")
}

/// The text of a graph; what it uses is written into the folder.
fn written(shape: Shape, folder: &Path) -> Result<String, Bad> {
    let first = "        \"n0\": (type: \"image.constant\", size: (64, 64)),\n";
    if !matches!(shape, Shape::Nested) {
        let nodes = format!("{first}{}", chain(NODES, shape));
        return Ok(graph("", &nodes, &format!("n{}", NODES - 1)));
    }
    let inner = "        \"n0\": (type: \"image.invert\", image: \"$image\"),\n";
    let inner = graph(" \"image\": (type: \"Image\") ", &format!("{inner}{}", chain(9, Shape::Plain)), "n8");
    std::fs::write(folder.join("inner.ron"), inner)?;
    let uses = |i: usize| format!("        \"n{i}\": (type: \"graph:inner.ron\", image: \"@n{}\"),\n", i - 1);
    let nodes: String = (1..=NODES / 10).map(uses).collect();
    let joins: String = (NODES / 10 + 1..NODES / 5).map(|i| node(i, Shape::Plain)).collect();
    Ok(graph("", &format!("{first}{nodes}{joins}"), &format!("n{}", NODES / 5 - 1)))
}

struct Client {
    server: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    uri: String,
    version: u64,
}

impl Client {
    fn started(folder: &Path, text: &str) -> Result<Self, Bad> {
        let mut server = Command::new(env!("CARGO_BIN_EXE_pegbar")).arg("lsp").stdin(Stdio::piped()).stdout(Stdio::piped()).spawn()?;
        let to = server.stdin.take().ok_or("no pipe")?;
        let from = BufReader::new(server.stdout.take().ok_or("no pipe")?);
        let uri = format!("file://{}", folder.join("main.ron").display());
        let mut client = Self { server, to, from, uri, version: 0 };
        client.ask("initialize", json!({ "capabilities": {} }))?;
        let document = json!({ "uri": client.uri, "languageId": "pegbar", "version": 0, "text": text });
        client.send(&json!({ "method": "textDocument/didOpen", "params": { "textDocument": document } }))?;
        client.until(|m| m["method"] == "textDocument/publishDiagnostics")?;
        Ok(client)
    }

    fn send(&mut self, message: &Value) -> Result<(), Bad> {
        let body = message.to_string();
        write!(self.to, "Content-Length: {}\r\n\r\n{body}", body.len())?;
        Ok(self.to.flush()?)
    }

    fn until(&mut self, is_it: impl Fn(&Value) -> bool) -> Result<Value, Bad> {
        loop {
            let mut length = 0;
            let mut line = String::new();
            while line != "\r\n" {
                line.clear();
                self.from.read_line(&mut line)?;
                length = line.strip_prefix("Content-Length: ").map_or(Ok(length), |n| n.trim().parse())?;
            }
            let mut body = vec![0; length];
            self.from.read_exact(&mut body)?;
            let message: Value = serde_json::from_slice(&body)?;
            if is_it(&message) {
                return Ok(message);
            }
        }
    }

    fn ask(&mut self, method: &str, params: Value) -> Result<Value, Bad> {
        self.version += 1;
        let id = self.version;
        self.send(&json!({ "id": id, "method": method, "params": params }))?;
        let answer = self.until(|m| m["id"] == id)?;
        answer.get("result").cloned().ok_or_else(|| answer["error"].to_string().into())
    }

    /// Types a blank at the top of the file.
    fn typed(&mut self) -> Result<(), Bad> {
        let nought = json!({ "line": 0, "character": 0 });
        let change = json!({ "range": { "start": nought, "end": nought }, "text": " " });
        let document = json!({ "uri": self.uri, "version": self.version });
        self.send(&json!({ "method": "textDocument/didChange", "params": { "textDocument": document, "contentChanges": [change] } }))
    }
}

fn row(name: &str, mut times: Vec<f64>) {
    times.sort_by(f64::total_cmp);
    let (least, median, greatest) = (times.first(), times.get(times.len() / 2), times.last());
    let shown = [least, median, greatest].map(|t| t.copied().unwrap_or_default());
    println!("  {name:<34} {:>8.2} {:>8.2} {:>8.2}", shown[0], shown[1], shown[2]);
}

fn millis(work: impl FnOnce() -> Result<(), Bad>) -> Result<f64, Bad> {
    let start = Instant::now();
    work()?;
    Ok(start.elapsed().as_secs_f64() * 1e3)
}

fn measure(shape: Shape) -> Result<(), Bad> {
    let folder = tempfile::tempdir()?;
    let text = written(shape, folder.path())?;
    println!("{shape:?}: {} bytes{:>24} {:>8} {:>8}", text.len(), "least", "median", "greatest");
    let registry = pegbar_nodes::registry();
    let checks: Result<Vec<f64>, Bad> = (0..ROUNDS)
        .map(|_| {
            let mut nodes = 0;
            let time = millis(|| {
                nodes = load_text(&folder.path().join("main.ron"), &text, &registry, &LoadOptions::default()).inferred.len();
                Ok(())
            })?;
            if nodes < NODES { Err(format!("{nodes} nodes").into()) } else { Ok(time) }
        })
        .collect();
    row("check, in the process", checks?);
    let mut client = Client::started(folder.path(), &text)?;
    let last = text.lines().enumerate().filter(|(_, l)| l.contains("type: \"comp")).last().map_or(0, |(i, _)| i);
    let column = text.lines().nth(last).and_then(|l| l.rfind("\"@n")).unwrap_or(0) + 3;
    let at = json!({ "textDocument": { "uri": client.uri }, "position": { "line": last, "character": column }, "newName": "other" });
    let range = json!({ "start": { "line": 0, "character": 0 }, "end": { "line": 9999, "character": 0 } });
    let whole = json!({ "textDocument": { "uri": client.uri }, "range": range, "context": {}, "options": {} });
    for method in ["completion", "hover", "definition", "references", "documentHighlight", "rename"] {
        let times = (0..ROUNDS).map(|_| {
            client.typed()?;
            millis(|| client.ask(&format!("textDocument/{method}"), at.clone()).map(drop))
        });
        row(method, times.collect::<Result<Vec<f64>, Bad>>()?);
    }
    for method in ["codeAction", "documentSymbol", "foldingRange", "formatting"] {
        let times = (0..ROUNDS).map(|_| {
            client.typed()?;
            millis(|| client.ask(&format!("textDocument/{method}"), whole.clone()).map(drop))
        });
        row(method, times.collect::<Result<Vec<f64>, Bad>>()?);
    }
    let times = (0..ROUNDS).map(|_| {
        client.typed()?;
        let version = client.version;
        client.version += 1;
        millis(|| client.until(|m| m["params"]["version"] == version).map(drop))
    });
    row("diagnostics after a keystroke", times.collect::<Result<Vec<f64>, Bad>>()?);
    client.ask("shutdown", Value::Null)?;
    client.send(&json!({ "method": "exit" }))?;
    client.server.wait()?;
    Ok(())
}

fn main() -> Result<(), Bad> {
    [Shape::Plain, Shape::Nested, Shape::Broken].into_iter().try_for_each(measure)
}
