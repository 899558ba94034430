//! The way of messages where no memory can be shared: two sockets. One carries messages, each behind its length, and behind a message the arrays that it
//! tells of. The other carries notes, for which nobody waits.

use std::io::{ErrorKind, IoSlice, Read, Write};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicI32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use super::link::Broken;
use super::notes::{Notes, RECORD};
use super::wire::Writer;

/// How long a host waits before it looks whether to go on waiting.
const LOOK: Duration = Duration::from_millis(10);
/// Looks for a message before going to sleep.
const LOOKS: usize = 100;
/// Where notes of this process go, for a signal's handler.
static SIDE: AtomicI32 = AtomicI32::new(-1);

/// One end.
pub(super) struct Pipe {
    main: UnixStream,
    side: UnixStream,
    notes: Arc<Notes>,
    /// Of a host, what came of a record so far.
    partial: Mutex<Vec<u8>>,
}

impl Pipe {
    /// A host's end, and the two sockets by which a worker comes to it.
    pub(super) fn new() -> std::io::Result<(Self, OwnedFd, OwnedFd)> {
        let ((main, main_there), (side, side_there)) = (UnixStream::pair()?, UnixStream::pair()?);
        main.set_read_timeout(Some(LOOK))?;
        main.set_write_timeout(Some(LOOK))?;
        side.set_nonblocking(true)?;
        let (notes, partial) = Default::default();
        Ok((Self { main, side, notes, partial }, main_there.into(), side_there.into()))
    }

    /// The worker's end, which ends this process where the host's is gone.
    pub(super) fn attach(main: OwnedFd, side: OwnedFd) -> std::io::Result<Self> {
        let (main, side) = (UnixStream::from(main), UnixStream::from(side));
        let (notes, partial): (Arc<Notes>, _) = Default::default();
        SIDE.store(side.as_raw_fd(), Ordering::Release);
        let (mut listened, noted) = (side.try_clone()?, notes.clone());
        std::thread::Builder::new().name("host".to_owned()).stack_size(1 << 16).spawn(move || {
            let mut word = [0; 4];
            loop {
                match listened.read_exact(&mut word) {
                    Ok(()) => noted.cancel.store(u32::from_ne_bytes(word), Ordering::Relaxed),
                    // SAFETY: ends this process, without the plugin's having its say.
                    Err(e) if e.kind() == ErrorKind::UnexpectedEof => unsafe { libc::_exit(0) },
                    // The plugin closed it.
                    Err(_) => return,
                }
            }
        })?;
        Ok(Self { main, side, notes, partial })
    }

    pub(super) fn notes(&self) -> &Arc<Notes> {
        &self.notes
    }

    /// Reads what the worker noted.
    pub(super) fn look(&self) {
        let mut partial = self.partial.lock().unwrap_or_else(PoisonError::into_inner);
        let mut bytes = [0; 64 * RECORD];
        while let Ok(read @ 1..) = (&self.side).read(&mut bytes) {
            partial.extend_from_slice(&bytes[..read]);
        }
        let (records, rest) = partial.as_chunks::<RECORD>();
        if let Some(last) = records.last() {
            self.notes.read(last);
        }
        *partial = rest.to_vec();
    }

    /// Tells the worker which task is to stop.
    pub(super) fn cancel(&self, task: u32) {
        // One that does not listen is ended.
        let _ = (&self.side).write(&task.to_ne_bytes());
    }

    pub(super) fn send(&self, message: &Writer, wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
        let length = (message.bytes.len() as u64).to_ne_bytes();
        // Both at once wake the other end once.
        let sent = match (&self.main).write_vectored(&[IoSlice::new(&length), IoSlice::new(&message.bytes)]) {
            Ok(sent) => sent,
            Err(e) => go_on(&e, wait).map(|()| 0)?,
        };
        self.write(&length[sent.min(length.len())..], wait)?;
        self.write(&message.bytes[sent.saturating_sub(length.len())..], wait)?;
        message.along.iter().try_for_each(|along| self.write(along.bytes(), wait))
    }

    pub(super) fn receive(&self, message: &mut Vec<u8>, most: usize, wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
        let mut length = [0; 8];
        self.look_for_message();
        self.read(&mut length, wait)?;
        let length = usize::try_from(u64::from_ne_bytes(length)).unwrap_or(usize::MAX);
        message.clear();
        if length > most || message.try_reserve(length).is_err() {
            return Err(Broken::Garbage);
        }
        message.resize(length, 0);
        self.read(message, wait)
    }

    /// Looks for a message for some microseconds: to sleep, and to be woken, takes longer than most tasks of little work.
    fn look_for_message(&self) {
        let mut byte = 0u8;
        for _ in 0..LOOKS {
            let flags = libc::MSG_PEEK | libc::MSG_DONTWAIT;
            // SAFETY: reads one byte into what is there, and leaves it to be read again.
            if unsafe { libc::recv(self.main.as_raw_fd(), (&raw mut byte).cast(), 1, flags) } >= 0 {
                return;
            }
        }
    }

    /// Reads an array that the message told of.
    pub(super) fn read(&self, mut bytes: &mut [u8], wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
        while !bytes.is_empty() {
            match (&self.main).read(bytes) {
                Ok(0) => return Err(Broken::Closed),
                Ok(read) => bytes = &mut bytes[read..],
                Err(e) => go_on(&e, wait)?,
            }
        }
        Ok(())
    }

    fn write(&self, mut bytes: &[u8], wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
        while !bytes.is_empty() {
            match (&self.main).write(bytes) {
                Ok(written) => bytes = &bytes[written..],
                Err(e) => go_on(&e, wait)?,
            }
        }
        Ok(())
    }
}

fn go_on(error: &std::io::Error, wait: &mut dyn FnMut() -> bool) -> Result<(), Broken> {
    match error.kind() {
        ErrorKind::Interrupted => Ok(()),
        ErrorKind::WouldBlock | ErrorKind::TimedOut if wait() => Ok(()),
        ErrorKind::WouldBlock | ErrorKind::TimedOut => Err(Broken::GivenUp),
        _ => Err(Broken::Closed),
    }
}

/// Sends the notes of this process, where they go over a socket: all of them or none. Does nothing but what a signal's handler may.
pub(super) fn send_notes(notes: &Notes) {
    let side = SIDE.load(Ordering::Acquire);
    if side >= 0 {
        let record = notes.record();
        // SAFETY: the record is that long; where there is no room nobody looks either.
        unsafe { libc::send(side, record.as_ptr().cast(), RECORD, libc::MSG_DONTWAIT) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::array::Data;
    use crate::plugin::worker::wire::Along;

    #[test]
    fn messages_and_arrays_of_any_length_go_there_and_back() {
        let (host, main, side) = Pipe::new().unwrap();
        let lengths = [0, 1, 1 << 12, (1 << 20) + 3];
        let worker = std::thread::spawn(move || {
            let worker = Pipe { main: main.into(), side: side.into(), notes: Arc::default(), partial: Mutex::default() };
            let mut message = Vec::new();
            for length in lengths {
                worker.receive(&mut message, usize::MAX, &mut || true).unwrap();
                let mut along = vec![0; length];
                worker.read(&mut along, &mut || true).unwrap();
                along.iter_mut().for_each(|b| *b ^= 1);
                worker.send(&Writer { along: vec![Along::Data(Data::U8(along))], ..Writer::default() }, &mut || true).unwrap();
            }
        });
        for length in lengths {
            let bytes: Vec<u8> = (0..length).map(|i| (i % 251) as u8).collect();
            let message = Writer { bytes: vec![7; length], along: vec![Along::Data(Data::U8(bytes.clone()))] };
            host.send(&message, &mut || true).unwrap();
            let (mut answer, mut back) = (Vec::new(), vec![0; length]);
            host.receive(&mut answer, 0, &mut || true).unwrap();
            host.read(&mut back, &mut || true).unwrap();
            assert!(back.iter().zip(&bytes).all(|(a, b)| *a == *b ^ 1), "{length}");
        }
        worker.join().unwrap();
    }

    #[test]
    fn what_is_no_message_is_told_and_waiting_can_be_given_up() {
        let (host, main, side) = Pipe::new().unwrap();
        let mut message = Vec::new();
        assert_eq!(host.receive(&mut message, 100, &mut || false), Err(Broken::GivenUp));
        let worker = UnixStream::from(main);
        (&worker).write_all(&u64::MAX.to_ne_bytes()).unwrap();
        assert_eq!(host.receive(&mut message, 100, &mut || true), Err(Broken::Garbage));
        drop(worker);
        assert_eq!(host.receive(&mut message, 100, &mut || true), Err(Broken::Closed));
        let noted = Notes::default();
        noted.beat(0.5);
        let record = noted.record();
        let mut there = UnixStream::from(side);
        // A record that is not all there yet is waited for.
        there.write_all(&record[..7]).unwrap();
        host.look();
        assert_eq!(host.notes().done(), 0.0);
        there.write_all(&record[7..]).unwrap();
        host.look();
        assert_eq!(host.notes().done(), 0.5);
        host.cancel(9);
        let mut word = [0; 4];
        there.read_exact(&mut word).unwrap();
        assert_eq!(u32::from_ne_bytes(word), 9);
    }
}
