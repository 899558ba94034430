//! Work split over rows: each thread has rows of its own, so the result never depends on their number.

/// The number of threads to use for `wanted` (0: one a processor) and `work` independent pieces.
pub(super) fn thread_count(wanted: usize, work: usize) -> usize {
    let available = || std::thread::available_parallelism().map_or(1, usize::from);
    let count = if wanted == 0 { available() } else { wanted };
    count.clamp(1, work.max(1))
}

/// Calls `f(first row, rows)` on bands of whole rows of `out`, each of `row_len` samples, on up to `threads` threads.
///
/// Small pictures are done on the calling thread: starting another costs more than 2¹⁶ samples do.
pub(super) fn for_bands<T: Send>(out: &mut [T], row_len: usize, threads: usize, f: impl Fn(usize, &mut [T]) + Sync) {
    let rows = out.len() / row_len.max(1);
    let count = thread_count(threads, (out.len() >> 16).max(1));
    if count == 1 || rows < 2 {
        return f(0, out);
    }
    let band = rows.div_ceil(count);
    std::thread::scope(|scope| {
        for (index, rows) in out.chunks_mut(band * row_len).enumerate() {
            let f = &f;
            scope.spawn(move || f(index * band, rows));
        }
    });
}

/// `f` of every item, in the order of the items, on up to `threads` threads; `None` stands where a call panicked.
pub(super) fn map_ordered<T: Send, R: Send>(items: Vec<T>, threads: usize, f: impl Fn(T) -> R + Sync) -> Vec<Option<R>> {
    let count = thread_count(threads, items.len());
    let guarded = |item: T| std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| f(item))).ok();
    if count == 1 {
        return items.into_iter().map(guarded).collect();
    }
    let share = items.len().div_ceil(count);
    let mut items = items.into_iter();
    let shares: Vec<Vec<T>> = (0..count).map(|_| items.by_ref().take(share).collect()).collect();
    std::thread::scope(|scope| {
        let guarded = &guarded;
        let handles: Vec<_> =
            shares.into_iter().map(|share| scope.spawn(move || share.into_iter().map(guarded).collect::<Vec<_>>())).collect();
        handles.into_iter().flat_map(|handle| handle.join().unwrap_or_else(|_| vec![None])).collect()
    })
}
