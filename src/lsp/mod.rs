//! `pegbar lsp`: a language server over the standard input and output, for editors.
//!
//! One thread reads messages, one answers them in order: whatever is asked is answered from the texts that the editor has open, and the
//! diagnostics are sent when nothing more waits. Checking runs no node. No message ends the server but `exit`.

mod complete;
mod cursor;
mod facts;
mod hover;
mod navigate;
mod outline;
mod publish;
mod sheet;
mod state;
mod text;
mod wire;

#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::io::{BufReader, Read, Write};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, sync_channel};

use pegbar_engine::check::LoadOptions;
use pegbar_engine::registry::Registry;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use crate::args::LspArgs;
use crate::console::{Console, EXIT_FAILED, EXIT_OK};
use publish::Published;
use state::State;
use text::{Change, Encoding, Position, Range, path_of};
use wire::{
    CANCELLED, Failure, INTERNAL_ERROR, INVALID_PARAMS, INVALID_REQUEST, Incoming, METHOD_NOT_FOUND, Message, NOT_INITIALIZED, Out,
};

/// Messages that wait between the two threads.
const QUEUE: usize = 1024;

pub(crate) fn lsp(args: &LspArgs, registry: &Registry, console: &mut Console) -> u8 {
    serve(registry, args.load_options(), std::io::stdin(), console.stdout)
}

/// Serves one editor until it says `exit` or goes away. Exit codes: 0 after `shutdown`, 1 without.
pub(crate) fn serve(registry: &Registry, options: LoadOptions, input: impl Read + Send, output: &mut dyn Write) -> u8 {
    let (sender, receiver) = sync_channel(QUEUE);
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let mut input = BufReader::new(input);
            while let Ok(Some(incoming)) = wire::read(&mut input) {
                // Nothing comes after it, and a read would wait for ever.
                let is_last = matches!(&incoming, Incoming::Message(m) if m.method.as_deref() == Some("exit"));
                if sender.send(incoming).is_err() || is_last {
                    break;
                }
            }
        });
        Server::new(registry, options, output).run(&receiver)
    })
}

/// Where a server is in its life.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// `initialize` has not come.
    New,
    Running,
    /// `shutdown` has come.
    Down,
}

struct Server<'a> {
    state: State<'a>,
    published: Published,
    out: Out<'a>,
    phase: Phase,
    /// The editor can be asked to watch files.
    can_watch: bool,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Place {
    text_document: DocumentId,
    position: Position,
    #[serde(default)]
    new_name: String,
    #[serde(default)]
    context: ReferenceContext,
}

#[derive(Deserialize)]
struct DocumentId {
    uri: String,
    #[serde(default)]
    version: Option<i64>,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct ReferenceContext {
    include_declaration: bool,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Whole {
    text_document: DocumentId,
    #[serde(default)]
    range: Range,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Opened {
    text_document: OpenedDocument,
}

#[derive(Deserialize)]
struct OpenedDocument {
    uri: String,
    #[serde(default)]
    version: i64,
    text: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Changed {
    text_document: DocumentId,
    content_changes: Vec<Change>,
}

/// The parameters of a method.
fn params<T: DeserializeOwned>(params: Value) -> Result<T, Failure> {
    serde_json::from_value(params).map_err(|e| Failure::new(INVALID_PARAMS, format!("expected other parameters: {e}")))
}

impl<'a> Server<'a> {
    fn new(registry: &'a Registry, options: LoadOptions, output: &'a mut dyn Write) -> Self {
        Self {
            state: State::new(registry, options),
            published: Published::default(),
            out: Out::new(output),
            phase: Phase::New,
            can_watch: false,
        }
    }

    fn run(&mut self, receiver: &Receiver<Incoming>) -> u8 {
        let mut waiting = VecDeque::new();
        loop {
            waiting.extend(receiver.try_iter().take(QUEUE.saturating_sub(waiting.len())));
            self.cancel(&mut waiting);
            if waiting.is_empty() {
                // Between two keystrokes there is time for what nobody waits for.
                self.refresh();
                match receiver.recv() {
                    Ok(incoming) => waiting.push_back(incoming),
                    Err(_) => break,
                }
                continue;
            }
            let Some(incoming) = waiting.pop_front() else { continue };
            let is_exit = matches!(&incoming, Incoming::Message(m) if m.method.as_deref() == Some("exit"));
            if is_exit || self.out.is_broken {
                break;
            }
            self.incoming(incoming);
        }
        if self.phase == Phase::Down { EXIT_OK } else { EXIT_FAILED }
    }

    /// Answers what was taken back before it was looked at.
    fn cancel(&mut self, waiting: &mut VecDeque<Incoming>) {
        let taken_back = |i: &Incoming| match i {
            Incoming::Message(m) if m.method.as_deref() == Some("$/cancelRequest") => m.params.get("id").cloned(),
            _ => None,
        };
        let ids: Vec<Value> = waiting.iter().filter_map(taken_back).collect();
        waiting.retain(|incoming| {
            let Incoming::Message(Message { id: Some(id), method: Some(_), .. }) = incoming else { return true };
            let is_cancelled = ids.contains(id);
            if is_cancelled {
                self.out.answer(id, Err(Failure::new(CANCELLED, "cancelled")));
            }
            !is_cancelled
        });
    }

    fn incoming(&mut self, incoming: Incoming) {
        let message = match incoming {
            Incoming::Message(message) => message,
            Incoming::Garbage(failure) => return self.out.answer(&Value::Null, Err(failure)),
        };
        match (message.id, message.method) {
            (Some(id), Some(method)) => {
                let result = self.guarded(|server| server.request(&method, message.params));
                self.out.answer(&id, result);
            }
            (None, Some(method)) => {
                // What goes wrong in a notification has no one to be told to.
                let _ = self.guarded(|server| server.notification(&method, message.params).map(|()| Value::Null));
            }
            // An answer to what the server asked for.
            (Some(_), None) => (),
            (None, None) => self.out.answer(&Value::Null, Err(Failure::new(INVALID_REQUEST, "expected a method, found none"))),
        }
    }

    /// Does some work; a panic in it is a fault of the server that the editor is told, and the server goes on.
    fn guarded(&mut self, work: impl FnOnce(&mut Self) -> Result<Value, Failure>) -> Result<Value, Failure> {
        catch_unwind(AssertUnwindSafe(|| work(self)))
            .unwrap_or_else(|_| Err(Failure::new(INTERNAL_ERROR, "the server is at fault: it panicked")))
    }

    fn refresh(&mut self) {
        if self.phase == Phase::Running && !self.state.stale.is_empty() {
            let _ = self.guarded(|server| {
                server.published.refresh(&mut server.state, &mut server.out);
                Ok(Value::Null)
            });
        }
    }

    fn request(&mut self, method: &str, given: Value) -> Result<Value, Failure> {
        match (self.phase, method) {
            (Phase::New, "initialize") => return Ok(self.initialize(&given)),
            (Phase::New, _) => return Err(Failure::new(NOT_INITIALIZED, "expected `initialize` first")),
            (_, "initialize") | (Phase::Down, _) => return Err(Failure::new(INVALID_REQUEST, "expected another request at this time")),
            (Phase::Running, "shutdown") => {
                self.phase = Phase::Down;
                return Ok(Value::Null);
            }
            (Phase::Running, _) => (),
        }
        if let Some(of_file) = OF_FILES.iter().find(|(name, _)| *name == method) {
            let whole: Whole = params(given)?;
            return Ok((of_file.1)(&mut self.state, &whole).unwrap_or_default());
        }
        let Some((_, answer)) = OF_PLACES.iter().find(|(name, _)| *name == method) else {
            return Err(Failure::new(METHOD_NOT_FOUND, format!("expected a method of the server, found {method}")));
        };
        let place: Place = params(given)?;
        let (answer, notice) = answer(&mut self.state, &place)?;
        if let Some(notice) = notice {
            self.out.notify("window/showMessage", json!({ "type": 3, "message": notice }));
        }
        Ok(answer)
    }

    fn initialize(&mut self, given: &Value) -> Value {
        self.phase = Phase::Running;
        let offered = given.pointer("/capabilities/general/positionEncodings").and_then(Value::as_array);
        if offered.is_some_and(|o| o.iter().any(|e| e == Encoding::Utf8.name())) {
            self.state.encoding = Encoding::Utf8;
        }
        let can = |path: &str| given.pointer(path).and_then(Value::as_bool).unwrap_or(false);
        self.state.has_snippets = can("/capabilities/textDocument/completion/completionItem/snippetSupport");
        self.can_watch = can("/capabilities/workspace/didChangeWatchedFiles/dynamicRegistration");
        let folders = given.pointer("/workspaceFolders/0/uri").or_else(|| given.get("rootUri")).and_then(Value::as_str);
        if self.state.options.out.as_os_str().is_empty() {
            self.state.options.out = folders.and_then(path_of).unwrap_or_default().join("out");
        }
        json!({
            "capabilities": capabilities(self.state.encoding),
            "serverInfo": { "name": "pegbar", "version": env!("CARGO_PKG_VERSION") },
        })
    }

    fn notification(&mut self, method: &str, given: Value) -> Result<(), Failure> {
        if self.phase != Phase::Running {
            return Ok(());
        }
        match method {
            "initialized" if self.can_watch => {
                let watchers = json!({ "watchers": [{ "globPattern": "**/*.ron" }] });
                let registration = json!({ "id": "files", "method": "workspace/didChangeWatchedFiles", "registerOptions": watchers });
                self.out.request("files", "client/registerCapability", json!({ "registrations": [registration] }));
            }
            "textDocument/didOpen" => {
                let OpenedDocument { uri, version, text } = params::<Opened>(given)?.text_document;
                self.state.open(uri, text, version);
            }
            "textDocument/didChange" => {
                let Changed { text_document: id, content_changes } = params(given)?;
                self.state.change(&id.uri, id.version.unwrap_or_default(), content_changes);
            }
            "textDocument/didClose" => self.state.close(&params::<Whole>(given)?.text_document.uri),
            // Files that are read may have come or gone since.
            "textDocument/didSave" | "workspace/didChangeWatchedFiles" => self.state.all_stale(),
            _ => (),
        }
        Ok(())
    }
}

/// What a request about a file is answered with.
type OfFile = fn(&mut State<'_>, &Whole) -> Option<Value>;
/// What a request about a place in a file is answered with, and what the user should know of it.
type OfPlace = fn(&mut State<'_>, &Place) -> Result<(Value, Option<String>), Failure>;

const OF_FILES: [(&str, OfFile); 4] = [
    ("textDocument/codeAction", |state, file| publish::fixes(state, &file.text_document.uri, file.range)),
    ("textDocument/documentSymbol", |state, file| outline::symbols(state, &file.text_document.uri)),
    ("textDocument/foldingRange", |state, file| outline::folds(state, &file.text_document.uri)),
    ("textDocument/formatting", |state, file| outline::formatting(state, &file.text_document.uri)),
];

const OF_PLACES: [(&str, OfPlace); 7] = [
    ("textDocument/completion", |state, at| found(complete::complete(state, &at.text_document.uri, at.position))),
    ("textDocument/definition", |state, at| found(navigate::definition(state, &at.text_document.uri, at.position))),
    ("textDocument/documentHighlight", |state, at| found(navigate::highlights(state, &at.text_document.uri, at.position))),
    ("textDocument/hover", |state, at| found(hover::hover(state, &at.text_document.uri, at.position))),
    ("textDocument/prepareRename", |state, at| found(navigate::prepare_rename(state, &at.text_document.uri, at.position))),
    ("textDocument/references", |state, at| {
        found(navigate::references(state, &at.text_document.uri, at.position, at.context.include_declaration))
    }),
    ("textDocument/rename", |state, at| navigate::rename(state, &at.text_document.uri, at.position, &at.new_name)),
];

/// Nothing found is `null`.
fn found(value: Option<Value>) -> Result<(Value, Option<String>), Failure> {
    Ok((value.unwrap_or_default(), None))
}

fn capabilities(encoding: Encoding) -> Value {
    json!({
        "positionEncoding": encoding.name(),
        "textDocumentSync": { "openClose": true, "change": 2, "save": { "includeText": false } },
        "completionProvider": { "triggerCharacters": ["\"", "@", "$", ".", "/", ":", "("] },
        "hoverProvider": true,
        "definitionProvider": true,
        "referencesProvider": true,
        "documentHighlightProvider": true,
        "renameProvider": { "prepareProvider": true },
        "documentSymbolProvider": true,
        "documentFormattingProvider": true,
        "foldingRangeProvider": true,
        "codeActionProvider": { "codeActionKinds": ["quickfix"] },
    })
}
