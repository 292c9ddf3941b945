//! How large a mesh may become in memory, by how large its file is.

/// Bytes of memory for each byte of the file: the densest honest file, a strip of one-byte indices, takes 12.
const GROWTH: usize = 16;
/// What every file may take: a small one that shows one mesh many times is honest too.
const FLOOR: usize = 64 << 20;

/// What is left to a file that may say more than it holds: glTF shows a mesh at any number of nodes and has accessors without bytes,
/// OBJ names a part for each face.
pub(crate) struct Budget {
    left: usize,
}

impl Budget {
    pub(crate) fn of(file_bytes: usize) -> Budget {
        Budget { left: file_bytes.saturating_mul(GROWTH).saturating_add(FLOOR) }
    }

    /// Takes so many items of so many bytes off.
    pub(crate) fn spend(&mut self, items: usize, bytes_each: usize) -> Result<(), String> {
        let rest = items.checked_mul(bytes_each).and_then(|bytes| self.left.checked_sub(bytes));
        self.left = rest.ok_or_else(|| format!("the file grows to over {GROWTH} bytes a byte and {} MiB", FLOOR >> 20))?;
        Ok(())
    }
}
