//! Buffers that come back: what the pilot's thread sends and takes in costs it neither an allocation
//! nor a release.
//!
//! The allocator of the system takes locks that every thread shares. So the pilot's thread only ever
//! takes buffers that exist, and puts them back; whoever reads a link or writes one allocates, where
//! the stock runs out, and releases, where a buffer has grown large.

use std::ops::Deref;
use std::sync::Arc;

use crossbeam_queue::ArrayQueue;

/// A buffer that once held more than this is released instead of kept.
const KEPT_BYTES: usize = 4096;

/// A stock of buffers.
#[derive(Debug, Clone)]
pub(super) struct Pool {
    /// With room for every buffer that can exist, so that putting back never fails.
    free: Arc<ArrayQueue<Vec<u8>>>,
    bytes: usize,
}

impl Pool {
    /// `ready` buffers of `bytes` each; at most `most` will ever be out.
    pub(super) fn new(ready: usize, most: usize, bytes: usize) -> Self {
        let free = ArrayQueue::new(most.max(ready).max(1));
        for _ in 0..ready {
            let _ = free.push(Vec::with_capacity(bytes));
        }
        Self { free: Arc::new(free), bytes }
    }

    /// With these bytes in it, without allocating. `None`: none is left, or it is too small.
    pub(super) fn lend(&self, bytes: &[u8]) -> Option<Chunk> {
        let mut buffer = self.free.pop()?;
        if bytes.len() > buffer.capacity() {
            let _ = self.free.push(buffer);
            return None;
        }
        buffer.extend_from_slice(bytes);
        Some(Chunk { buffer, home: Some(self.free.clone()) })
    }

    /// An empty one, made where none is left; for threads that may allocate.
    pub(super) fn make(&self) -> Chunk {
        let kept = self.free.pop().filter(|buffer| buffer.capacity() <= KEPT_BYTES);
        let buffer = kept.unwrap_or_else(|| Vec::with_capacity(self.bytes));
        Chunk { buffer, home: Some(self.free.clone()) }
    }
}

/// A buffer of a pool; goes back when dropped.
#[derive(Debug, Default)]
pub(super) struct Chunk {
    buffer: Vec<u8>,
    home: Option<Arc<ArrayQueue<Vec<u8>>>>,
}

impl Chunk {
    /// To write into.
    pub(super) fn buffer(&mut self) -> &mut Vec<u8> {
        &mut self.buffer
    }
}

impl Deref for Chunk {
    type Target = [u8];
    fn deref(&self) -> &[u8] {
        &self.buffer
    }
}

impl Drop for Chunk {
    fn drop(&mut self) {
        if let Some(home) = &self.home {
            self.buffer.clear();
            let _ = home.push(std::mem::take(&mut self.buffer));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_buffers_come_back_and_large_ones_are_released() {
        let pool = Pool::new(2, 8, 16);
        let (a, b) = (pool.lend(&[1; 16]).unwrap(), pool.lend(&[2]).unwrap());
        assert_eq!((&*a, &*b), (&[1; 16][..], &[2][..]));
        assert!(pool.lend(&[3]).is_none(), "none is left");
        drop(a);
        assert!(pool.lend(&[0; 17]).is_none(), "too small");
        assert_eq!(&*pool.lend(&[4]).unwrap(), &[4], "and it is still there");

        let mut large = pool.make();
        large.buffer().extend([0; 100_000]);
        drop(large);
        for _ in 0..2 {
            assert!(pool.make().buffer().capacity() <= KEPT_BYTES);
        }
        drop(b);
    }
}
