//! What Linux lets a process give up.

use std::ffi::CString;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::path::{Path, PathBuf};

use super::fail;

/// Has this process end when the thread that started it is gone, which is there for as long as its process.
pub(super) fn end_with_parent() -> bool {
    // SAFETY: sets a flag of this process.
    unsafe { libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGKILL) == 0 }
}

/// Gives up the network, and writing anywhere but under `writable`, as far as this kernel lets it: Landlock (Linux 5.13) and seccomp. Reading files,
/// devices, and sockets of this machine stay.
pub(in super::super) fn give_up(writable: &[PathBuf]) {
    // SAFETY: sets a flag of this process, which lasts.
    unsafe { libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) };
    // What the kernel does not know of is done without.
    let _ = write_only_under(writable);
    let _ = no_network();
}

/// Before a task: what the system refuses from here on, it refuses this.
pub(in super::super) fn forget_errors() {
    // SAFETY: the word is this thread's.
    unsafe { *libc::__errno_location() = 0 };
}

/// Bytes of memory that this process has asked for to write to. Does nothing but what a signal's handler may.
pub(super) fn data_of_process() -> u64 {
    let mut text = [0u8; 128];
    // SAFETY: reads into what is there, from a file that is closed again.
    let (length, page) = unsafe {
        let file = libc::open(c"/proc/self/statm".as_ptr(), libc::O_RDONLY | libc::O_CLOEXEC);
        let length = libc::read(file, text.as_mut_ptr().cast(), text.len());
        libc::close(file);
        (length, libc::sysconf(libc::_SC_PAGESIZE))
    };
    let text = text.get(..usize::try_from(length).unwrap_or(0)).unwrap_or_default();
    let number = |word: &[u8]| word.iter().fold(0u64, |n, c| n.wrapping_mul(10).wrapping_add(u64::from(c.wrapping_sub(b'0'))));
    let pages = text.split(|c| *c == b' ').nth(5).map_or(0, number);
    pages.saturating_mul(u64::try_from(page).unwrap_or(4096))
}

const WRITE_FILE: u64 = 1 << 1;
/// Making and removing of files, links and folders.
const MAKE: u64 = 0b1_1111_1111 << 4;
const REFER: u64 = 1 << 13;
const TRUNCATE: u64 = 1 << 14;

#[repr(C)]
struct Ruleset {
    handled: u64,
}

#[repr(C, packed)]
struct Beneath {
    allowed: u64,
    folder: i32,
}

fn write_only_under(writable: &[PathBuf]) -> std::io::Result<()> {
    // SAFETY: asks for the version; nothing is pointed at.
    let version = unsafe { libc::syscall(libc::SYS_landlock_create_ruleset, std::ptr::null::<u8>(), 0usize, 1u32) };
    if version < 1 {
        return Err(fail());
    }
    let handled = WRITE_FILE | MAKE | if version >= 2 { REFER } else { 0 } | if version >= 3 { TRUNCATE } else { 0 };
    let asked = Ruleset { handled };
    // SAFETY: the struct is as long as it says; what comes back is a file of ours.
    let rules = unsafe {
        let rules = libc::syscall(libc::SYS_landlock_create_ruleset, &raw const asked, size_of::<Ruleset>(), 0u32);
        if rules < 0 {
            return Err(fail());
        }
        OwnedFd::from_raw_fd(rules as i32)
    };
    allow(&rules, Path::new("/dev"), (WRITE_FILE | TRUNCATE) & handled)?;
    for folder in writable {
        allow(&rules, folder, handled)?;
    }
    // SAFETY: a file of ours.
    match unsafe { libc::syscall(libc::SYS_landlock_restrict_self, rules.as_raw_fd(), 0u32) } {
        0 => Ok(()),
        _ => Err(fail()),
    }
}

fn allow(rules: &OwnedFd, folder: &Path, allowed: u64) -> std::io::Result<()> {
    let Ok(path) = CString::new(folder.as_os_str().as_encoded_bytes()) else { return Ok(()) };
    // SAFETY: the path is a text that ends with a nought; what comes back is ours.
    let opened = unsafe { libc::open(path.as_ptr(), libc::O_PATH | libc::O_CLOEXEC) };
    if opened < 0 {
        // Where nothing is, nothing can be written.
        return Ok(());
    }
    // SAFETY: as above.
    let opened = unsafe { OwnedFd::from_raw_fd(opened) };
    let rule = Beneath { allowed, folder: opened.as_raw_fd() };
    // SAFETY: files of ours, and a struct that is there through the call; 1 is the kind of rule that it is.
    match unsafe { libc::syscall(libc::SYS_landlock_add_rule, rules.as_raw_fd(), 1u32, &raw const rule, 0u32) } {
        0 => Ok(()),
        _ => Err(fail()),
    }
}

#[cfg(target_arch = "x86_64")]
const ARCHITECTURE: u32 = 0xc000_003e;
#[cfg(target_arch = "aarch64")]
const ARCHITECTURE: u32 = 0xc000_00b7;

/// Refuses sockets of other kinds than this machine's own.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
fn no_network() -> std::io::Result<()> {
    let load = (libc::BPF_LD | libc::BPF_W | libc::BPF_ABS) as u16;
    let equal = (libc::BPF_JMP | libc::BPF_JEQ | libc::BPF_K) as u16;
    let end = (libc::BPF_RET | libc::BPF_K) as u16;
    let step = |code: u16, k: u32, jt: u8, jf: u8| libc::sock_filter { code, jt, jf, k };
    let refused = libc::SECCOMP_RET_ERRNO | libc::EACCES as u32;
    // The words of what is looked at: number of the call, architecture, and from the sixteenth byte its arguments.
    let program = [
        step(load, 4, 0, 0),
        step(equal, ARCHITECTURE, 0, 5),
        step(load, 0, 0, 0),
        step(equal, libc::SYS_io_uring_setup as u32, 4, 0),
        step(equal, libc::SYS_socket as u32, 0, 2),
        step(load, 16, 0, 0),
        step(equal, libc::AF_UNIX as u32, 0, 1),
        step(end, libc::SECCOMP_RET_ALLOW, 0, 0),
        step(end, refused, 0, 0),
    ];
    let program = libc::sock_fprog { len: program.len() as u16, filter: program.as_ptr().cast_mut() };
    // SAFETY: the program is there through the call, which copies it.
    match unsafe { libc::prctl(libc::PR_SET_SECCOMP, libc::SECCOMP_MODE_FILTER, &raw const program) } {
        0 => Ok(()),
        _ => Err(fail()),
    }
}

#[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64")))]
fn no_network() -> std::io::Result<()> {
    Err(std::io::Error::from(std::io::ErrorKind::Unsupported))
}
