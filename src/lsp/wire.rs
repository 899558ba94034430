//! Messages between an editor and the server: JSON-RPC 2.0 behind `Content-Length` headers.
//!
//! What cannot be read is told to the editor and passed over, so that no message ends the server.

use std::io::{self, BufRead, Read, Write};

use serde::Deserialize;
use serde_json::{Value, json};

/// The text is no JSON.
pub(super) const PARSE_ERROR: i64 = -32700;
/// The JSON is no request, or comes at the wrong time.
pub(super) const INVALID_REQUEST: i64 = -32600;
/// There is no such method.
pub(super) const METHOD_NOT_FOUND: i64 = -32601;
/// The parameters are not those of the method.
pub(super) const INVALID_PARAMS: i64 = -32602;
/// The server is at fault.
pub(super) const INTERNAL_ERROR: i64 = -32603;
/// A request came before `initialize`.
pub(super) const NOT_INITIALIZED: i64 = -32002;
/// The editor took the request back.
pub(super) const CANCELLED: i64 = -32800;
/// The request is well-formed, but what it asks for cannot be done.
pub(super) const REQUEST_FAILED: i64 = -32803;

/// Longer messages are read and thrown away.
const MAX_BYTES: u64 = 256 << 20;
/// Longer lines of headers are none.
const MAX_HEADER_BYTES: u64 = 4096;

/// Why a request has no result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Failure {
    pub(super) code: i64,
    pub(super) message: String,
}

impl Failure {
    pub(super) fn new(code: i64, message: impl Into<String>) -> Self {
        Self { code, message: message.into() }
    }
}

/// One message of an editor.
#[derive(Debug, Deserialize)]
pub(super) struct Message {
    /// There for requests and responses; a number or a text.
    #[serde(default)]
    pub(super) id: Option<Value>,
    /// There for requests and notifications.
    #[serde(default)]
    pub(super) method: Option<String>,
    #[serde(default)]
    pub(super) params: Value,
}

/// What came in.
#[derive(Debug)]
pub(super) enum Incoming {
    Message(Message),
    /// Something that is no message.
    Garbage(Failure),
}

/// The next message; `None` at the end of the stream.
pub(super) fn read(input: &mut impl BufRead) -> io::Result<Option<Incoming>> {
    let Some(length) = read_headers(input)? else { return Ok(None) };
    let Some(length) = length else {
        return Ok(Some(Incoming::Garbage(Failure::new(PARSE_ERROR, "expected a header Content-Length, found none"))));
    };
    if length > MAX_BYTES {
        io::copy(&mut input.take(length), &mut io::sink())?;
        let message = format!("expected a message of at most {MAX_BYTES} bytes, found {length}");
        return Ok(Some(Incoming::Garbage(Failure::new(INVALID_REQUEST, message))));
    }
    let mut body = Vec::new();
    if input.take(length).read_to_end(&mut body)? as u64 != length {
        return Ok(None);
    }
    Ok(Some(parse(&body)))
}

fn parse(body: &[u8]) -> Incoming {
    let value: Value = match serde_json::from_slice(body) {
        Ok(value) => value,
        Err(error) => return Incoming::Garbage(Failure::new(PARSE_ERROR, format!("expected JSON, found what is none: {error}"))),
    };
    // A list would be read as a record too, field by field.
    if !value.is_object() {
        return Incoming::Garbage(Failure::new(INVALID_REQUEST, "expected a request, found JSON that is no object"));
    }
    match serde_json::from_value(value) {
        Ok(message) => Incoming::Message(message),
        Err(error) => Incoming::Garbage(Failure::new(INVALID_REQUEST, format!("expected a request, found another thing: {error}"))),
    }
}

/// Reads up to the empty line. The length of what follows, if it is said; `None` at the end of the stream.
fn read_headers(input: &mut impl BufRead) -> io::Result<Option<Option<u64>>> {
    let mut length = None;
    loop {
        let mut line = Vec::new();
        if input.take(MAX_HEADER_BYTES).read_until(b'\n', &mut line)? == 0 {
            return Ok(None);
        }
        let line = String::from_utf8_lossy(&line);
        let line = line.trim_end();
        if line.is_empty() {
            return Ok(Some(length));
        }
        if let Some((name, value)) = line.split_once(':')
            && name.trim().eq_ignore_ascii_case("content-length")
        {
            length = value.trim().parse().ok();
        }
    }
}

/// Where messages to the editor go.
pub(super) struct Out<'a> {
    stream: &'a mut dyn Write,
    /// The editor went away.
    pub(super) is_broken: bool,
}

impl<'a> Out<'a> {
    pub(super) fn new(stream: &'a mut dyn Write) -> Self {
        Self { stream, is_broken: false }
    }

    /// Answers a request.
    pub(super) fn answer(&mut self, id: &Value, result: Result<Value, Failure>) {
        self.send(&match result {
            Ok(result) => json!({ "jsonrpc": "2.0", "id": id, "result": result }),
            Err(f) => json!({ "jsonrpc": "2.0", "id": id, "error": { "code": f.code, "message": f.message } }),
        });
    }

    /// Tells the editor something.
    pub(super) fn notify(&mut self, method: &str, params: Value) {
        self.send(&json!({ "jsonrpc": "2.0", "method": method, "params": params }));
    }

    /// Asks the editor for something; what it answers is not looked at.
    pub(super) fn request(&mut self, id: &str, method: &str, params: Value) {
        self.send(&json!({ "jsonrpc": "2.0", "id": id, "method": method, "params": params }));
    }

    fn send(&mut self, message: &Value) {
        // Many times as fast as `to_string`, which goes through a formatter.
        let Ok(body) = serde_json::to_vec(message) else { return };
        let written = write!(self.stream, "Content-Length: {}\r\n\r\n", body.len());
        let written = written.and_then(|()| self.stream.write_all(&body)).and_then(|()| self.stream.flush());
        self.is_broken |= written.is_err();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &str) -> Vec<Result<String, i64>> {
        let mut input = text.as_bytes();
        let mut out = Vec::new();
        while let Some(next) = read(&mut input).unwrap() {
            out.push(match next {
                Incoming::Message(message) => Ok(message.method.unwrap_or_default()),
                Incoming::Garbage(failure) => Err(failure.code),
            });
        }
        out
    }

    fn framed(body: &str) -> String {
        format!("Content-Length: {}\r\n\r\n{body}", body.len())
    }

    #[test]
    fn what_is_no_message_is_told_and_passed_over() {
        let good = framed(r#"{"jsonrpc":"2.0","method":"é"}"#);
        assert_eq!(all(&format!("{}{good}", framed("{"))), [Err(PARSE_ERROR), Ok("é".to_owned())]);
        assert_eq!(all(&format!("{}{good}", framed("[1]"))), [Err(INVALID_REQUEST), Ok("é".to_owned())]);
        assert_eq!(all(&format!("{}{good}", framed(r#"{"method":1}"#))), [Err(INVALID_REQUEST), Ok("é".to_owned())]);
        assert_eq!(all(&format!("Content-Type: x\r\n\r\n{good}")), [Err(PARSE_ERROR), Ok("é".to_owned())]);
        assert_eq!(all(&format!("content-length:  many\r\n\r\n{good}")), [Err(PARSE_ERROR), Ok("é".to_owned())]);
        assert_eq!(all(&format!("Content-Type: x\n{good}")), [Ok("é".to_owned())]);
    }

    #[test]
    fn a_stream_that_breaks_off_has_no_further_message() {
        assert_eq!(all("Content-Length: 90\r\n\r\n{"), []);
        assert_eq!(all("Content-Le"), []);
        assert_eq!(all(""), []);
    }
}
