//! What a host and a worker say to each other.

use std::sync::Arc;

use super::wire::{Reader, Writer};
use crate::array::DType;
use crate::clock::Clock;
use crate::node::NodeError;
use crate::plugin::call::Settings;
use crate::plugin::settings::SettingData;

/// First word of what a host begins with.
pub(super) const LOAD: u32 = 1;
pub(super) const TASK: u32 = 2;
pub(super) const QUIT: u32 = 3;

/// First word of what a worker says.
pub(super) const DONE: u32 = 11;
pub(super) const FAILED: u32 = 12;
#[cfg(target_os = "linux")]
pub(super) const ALLOC: u32 = 13;
pub(super) const FETCH: u32 = 14;
pub(super) const LOG: u32 = 15;

/// What a task asks for.
pub(super) const COMPUTE: u32 = 0;
pub(super) const NEEDS: u32 = 1;

/// Kinds of ports.
pub(super) const VALUE: u32 = 0;
pub(super) const FRAMES: u32 = 1;
pub(super) const SEQUENCE: u32 = 2;
pub(super) const NUMBER: u32 = 3;

/// Where an array lies: in the message, in the memory that is shared, or behind the message.
pub(super) const HERE: u32 = 0;
pub(super) const THERE: u32 = 1;
pub(super) const ALONG: u32 = 2;

/// What a made value is.
pub(super) const PARTS: u32 = 0;
pub(super) const PASSED: u32 = 1;

/// Arrays below this are packed with others, or go in messages.
pub(super) const LARGE: usize = 1 << 16;

pub(super) fn write_dtype(to: &mut Writer, dtype: DType) {
    to.u32(match dtype {
        DType::F32 => 1,
        DType::F64 => 2,
        DType::I64 => 3,
        DType::U32 => 4,
        DType::U8 => 5,
    });
}

pub(super) fn read_dtype(from: &mut Reader) -> Option<DType> {
    Some(match from.u32()? {
        1 => DType::F32,
        2 => DType::F64,
        3 => DType::I64,
        4 => DType::U32,
        5 => DType::U8,
        _ => return None,
    })
}

pub(super) fn write_shape(to: &mut Writer, shape: &[usize]) {
    to.list(shape, |to, &n| to.u64(n as u64));
}

pub(super) fn read_shape(from: &mut Reader) -> Option<Vec<usize>> {
    from.list(Reader::size)
}

/// Bytes of an array; `None` where there are more than can be.
pub(super) fn bytes_of(dtype: DType, shape: &[usize]) -> Option<usize> {
    shape.iter().try_fold(dtype.size(), |n, &d| n.checked_mul(d))
}

pub(super) fn write_clock(to: &mut Writer, clock: &Clock) {
    to.text(&clock.name);
    to.i64(clock.first);
    to.i64(clock.last);
    to.u32(clock.fps.0);
    to.u32(clock.fps.1);
}

pub(super) fn read_clock(from: &mut Reader) -> Option<Clock> {
    Some(Clock { name: from.text()?.to_owned(), first: from.i64()?, last: from.i64()?, fps: (from.u32()?, from.u32()?) })
}

pub(super) fn write_option<T>(to: &mut Writer, item: Option<&T>, one: impl FnOnce(&mut Writer, &T)) {
    to.u32(u32::from(item.is_some()));
    if let Some(item) = item {
        one(to, item);
    }
}

#[allow(clippy::option_option, reason = "the outer one says that the message is broken")]
pub(super) fn read_option<'a, T>(from: &mut Reader<'a>, one: impl FnOnce(&mut Reader<'a>) -> Option<T>) -> Option<Option<T>> {
    match from.u32()? {
        0 => Some(None),
        1 => one(from).map(Some),
        _ => None,
    }
}

pub(super) fn write_settings(to: &mut Writer, settings: &Settings) {
    to.list(&settings.items, |to, (input, data)| {
        to.u32(*input);
        to.text(&data.ron);
        to.text(&data.text);
        to.list(&data.numbers, |to, n| to.f64(*n));
        to.list(&data.wholes, |to, n| to.i64(*n));
    });
}

pub(super) fn read_settings(from: &mut Reader) -> Option<Arc<Settings>> {
    let items = from.list(|from| {
        let input = from.u32()?;
        let (ron, text) = (from.text()?.to_owned(), from.text()?.to_owned());
        Some((input, SettingData { ron, text, numbers: from.list(Reader::f64)?, wholes: from.list(Reader::i64)? }))
    })?;
    Some(Arc::new(Settings { items, literals: Vec::new(), kept: std::sync::OnceLock::new() }))
}

pub(super) fn write_error(to: &mut Writer, error: &NodeError) {
    to.text(&serde_json::to_string(error).unwrap_or_default());
}

pub(super) fn read_error(from: &mut Reader) -> Option<NodeError> {
    serde_json::from_str(from.text()?).ok()
}
