//! Leaving at once.
#![allow(unsafe_code, reason = "a process that shares this one's memory cannot be had otherwise; it reads none of it")]

/// Ends the process with `code` without making its caller wait for the memory: the system needs a tenth of a second for each gigabyte that it takes
/// back, and does so when the last of those who share it is gone. That is a second process, which stays for as long as this one is there.
pub fn leave(code: u8) -> ! {
    #[cfg(target_os = "linux")]
    share();
    std::process::exit(i32::from(code))
}

#[cfg(target_os = "linux")]
fn share() {
    const STACK: usize = 1 << 14;
    // 16 bytes are what every processor's calling convention is content with.
    let stack: &'static mut [u128] = vec![0; STACK / 16].leak();
    // SAFETY: the stack lives for ever and grows down from its end; what runs on it takes no lock, allocates nothing and ends by itself. Where no
    // process can be made, leaving takes a little longer.
    let _ = unsafe {
        libc::clone(linger, stack.as_mut_ptr_range().end.cast(), libc::CLONE_VM, std::process::id() as usize as *mut libc::c_void)
    };
}

#[cfg(target_os = "linux")]
extern "C" fn linger(parent: *mut libc::c_void) -> libc::c_int {
    // SAFETY: system calls alone. Files and pipes are its own copies, which others would wait for; the process that made it is gone once it has
    // another parent.
    unsafe {
        libc::syscall(libc::SYS_close_range, 0, libc::c_uint::MAX, 0);
        let pause = libc::timespec { tv_sec: 0, tv_nsec: 1_000_000 };
        while libc::getppid() as usize == parent as usize {
            libc::nanosleep(&pause, std::ptr::null_mut());
        }
    }
    0
}
