//! An editor as small as can be: it writes and reads the protocol's bytes through pipes.

use std::io::{BufRead, BufReader, PipeReader, PipeWriter, Read, Write};
use std::thread::JoinHandle;

use pegbar_engine::check::LoadOptions;
use serde_json::{Value, json};

pub(super) struct Client {
    pub(super) folder: tempfile::TempDir,
    to: Option<PipeWriter>,
    from: BufReader<PipeReader>,
    server: Option<JoinHandle<u8>>,
    next: u64,
    version: i64,
    /// Notifications that nobody has looked at yet.
    notes: Vec<Value>,
}

/// The text without its mark `|`, and the position of the mark.
pub(super) fn marked(text: &str) -> (String, Value) {
    let at = text.find('|').unwrap();
    (text.replacen('|', "", 1), position(text, at))
}

/// Line and column of a byte offset, in UTF-16.
pub(super) fn position(text: &str, offset: usize) -> Value {
    let before = &text[..offset];
    let line = before.rfind('\n').map_or(0, |n| n + 1);
    json!({ "line": before.matches('\n').count(), "character": before[line..].encode_utf16().count() })
}

/// The byte offset of a position, in UTF-16.
pub(super) fn offset(text: &str, position: &Value) -> usize {
    let line = position["line"].as_u64().unwrap() as usize;
    let start = if line == 0 { 0 } else { text.match_indices('\n').nth(line - 1).unwrap().0 + 1 };
    let mut units = position["character"].as_u64().unwrap() as usize;
    let mut at = start;
    for c in text[start..].chars() {
        if units == 0 {
            break;
        }
        units -= c.len_utf16();
        at += c.len_utf8();
    }
    at
}

/// The text that a range marks.
pub(super) fn slice<'t>(text: &'t str, range: &Value) -> &'t str {
    &text[offset(text, &range["start"])..offset(text, &range["end"])]
}

/// The text after edits.
pub(super) fn edited(text: &str, edits: &Value) -> String {
    let mut edits: Vec<_> = edits.as_array().unwrap().iter().collect();
    edits.sort_by_key(|e| std::cmp::Reverse(offset(text, &e["range"]["start"])));
    let mut out = text.to_owned();
    for edit in edits {
        let (start, end) = (offset(text, &edit["range"]["start"]), offset(text, &edit["range"]["end"]));
        out.replace_range(start..end, edit["newText"].as_str().unwrap());
    }
    out
}

impl Client {
    /// A server to which nothing has been said.
    pub(super) fn new() -> Self {
        Self::with(tempfile::tempdir().unwrap(), LoadOptions::default())
    }

    /// A server that checks graphs with these options.
    pub(super) fn with(folder: tempfile::TempDir, options: LoadOptions) -> Self {
        let (server_in, to) = std::io::pipe().unwrap();
        let (from, mut server_out) = std::io::pipe().unwrap();
        let server = std::thread::spawn(move || super::super::serve(&pegbar_nodes::registry(), options, server_in, &mut server_out));
        Self { folder, to: Some(to), from: BufReader::new(from), server: Some(server), next: 0, version: 0, notes: Vec::new() }
    }

    /// A server that knows an editor with snippets.
    pub(super) fn started() -> Self {
        let mut client = Self::new();
        let completion = json!({ "completionItem": { "snippetSupport": true } });
        client.initialize(json!({ "textDocument": { "completion": completion } }));
        client
    }

    pub(super) fn initialize(&mut self, capabilities: Value) -> Value {
        let root = self.uri("");
        let result = self.ask("initialize", json!({ "processId": null, "rootUri": root, "capabilities": capabilities })).unwrap();
        self.tell("initialized", json!({}));
        result
    }

    pub(super) fn uri(&self, name: &str) -> String {
        super::super::text::uri_of(&self.folder.path().canonicalize().unwrap().join(name))
    }

    pub(super) fn write(&self, name: &str, text: &str) {
        let path = self.folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    /// Bytes as they are.
    pub(super) fn raw(&mut self, bytes: &str) {
        self.to.as_mut().unwrap().write_all(bytes.as_bytes()).unwrap();
    }

    /// A message as it is.
    pub(super) fn send(&mut self, message: &Value) {
        let body = message.to_string();
        self.raw(&format!("Content-Length: {}\r\n\r\n{body}", body.len()));
    }

    pub(super) fn tell(&mut self, method: &str, params: Value) {
        self.send(&json!({ "jsonrpc": "2.0", "method": method, "params": params }));
    }

    /// Sends a request, and gives its number.
    pub(super) fn request(&mut self, method: &str, params: Value) -> u64 {
        self.next += 1;
        self.send(&json!({ "jsonrpc": "2.0", "id": self.next, "method": method, "params": params }));
        self.next
    }

    /// The next message of the server.
    pub(super) fn receive(&mut self) -> Value {
        let mut length = 0;
        loop {
            let mut line = String::new();
            assert!(self.from.read_line(&mut line).unwrap() > 0, "the server went away");
            if line == "\r\n" {
                break;
            }
            length = line.strip_prefix("Content-Length: ").map_or(length, |n| n.trim().parse().unwrap());
        }
        let mut body = vec![0; length];
        self.from.read_exact(&mut body).unwrap();
        serde_json::from_slice(&body).unwrap()
    }

    /// The answer to a request: its result, or its error.
    pub(super) fn answer(&mut self, id: &Value) -> Result<Value, Value> {
        loop {
            let message = self.receive();
            if message.get("method").is_some() {
                self.notes.push(message);
            } else if message["id"] == *id {
                return message.get("result").cloned().ok_or_else(|| message["error"].clone());
            }
        }
    }

    pub(super) fn ask(&mut self, method: &str, params: Value) -> Result<Value, Value> {
        let id = self.request(method, params);
        self.answer(&json!(id))
    }

    /// The next message of that method that nobody has looked at.
    pub(super) fn note(&mut self, method: &str) -> Value {
        loop {
            if let Some(at) = self.notes.iter().position(|n| n["method"] == method) {
                return self.notes.remove(at)["params"].clone();
            }
            let message = self.receive();
            self.notes.push(message);
        }
    }

    pub(super) fn open(&mut self, name: &str, text: &str) {
        self.version += 1;
        let document = json!({ "uri": self.uri(name), "languageId": "pegbar", "version": self.version, "text": text });
        self.tell("textDocument/didOpen", json!({ "textDocument": document }));
    }

    pub(super) fn change(&mut self, name: &str, changes: Value) {
        self.version += 1;
        let document = json!({ "uri": self.uri(name), "version": self.version });
        self.tell("textDocument/didChange", json!({ "textDocument": document, "contentChanges": changes }));
    }

    pub(super) fn close(&mut self, name: &str) {
        let uri = self.uri(name);
        self.tell("textDocument/didClose", json!({ "textDocument": { "uri": uri } }));
    }

    /// The next diagnostics of a file.
    pub(super) fn diagnostics(&mut self, name: &str) -> Vec<Value> {
        let uri = self.uri(name);
        loop {
            let params = self.note("textDocument/publishDiagnostics");
            if params["uri"] == uri {
                return params["diagnostics"].as_array().unwrap().clone();
            }
        }
    }

    /// The codes of the next diagnostics of a file.
    pub(super) fn said(&mut self, name: &str) -> Vec<String> {
        self.diagnostics(name).iter().map(|d| d["code"].as_str().unwrap().to_owned()).collect()
    }

    /// Asks about the place of the mark `|` in a text, which is opened with it.
    pub(super) fn at_mark(&mut self, method: &str, name: &str, text: &str, more: Value) -> Result<Value, Value> {
        let (text, position) = marked(text);
        self.open(name, &text);
        self.at(method, name, &position, more)
    }

    pub(super) fn at(&mut self, method: &str, name: &str, position: &Value, more: Value) -> Result<Value, Value> {
        let mut params = json!({ "textDocument": { "uri": self.uri(name) }, "position": position });
        more.as_object().into_iter().flatten().for_each(|(k, v)| params[k] = v.clone());
        self.ask(&format!("textDocument/{method}"), params)
    }

    /// Asks about a whole file.
    pub(super) fn whole(&mut self, method: &str, name: &str, more: Value) -> Value {
        let mut params = json!({ "textDocument": { "uri": self.uri(name) } });
        more.as_object().into_iter().flatten().for_each(|(k, v)| params[k] = v.clone());
        self.ask(&format!("textDocument/{method}"), params).unwrap()
    }

    /// Closes the pipe to the server; its exit code.
    pub(super) fn end(&mut self) -> u8 {
        self.to = None;
        // What it still had to say makes room for it to end.
        let mut rest = Vec::new();
        self.from.read_to_end(&mut rest).unwrap();
        self.server.take().unwrap().join().unwrap()
    }
}
