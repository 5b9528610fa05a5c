//! Tables of losses for the log, used again once the recorder has let go of them: the control loop
//! asks for no memory in steady flight.

use std::sync::Arc;

use haltere_core::drops::Drops;

/// Losses by link number.
pub(crate) type Table = Vec<(u8, Drops)>;

/// Tables in turn. The recorder holds one for some 20 ms, and one is told each second.
const TABLES: usize = 4;

/// Tables that are used again.
#[derive(Debug, Default)]
pub(crate) struct Shelf {
    tables: [Arc<Table>; TABLES],
    next: usize,
}

impl Shelf {
    /// A table with these rows.
    pub fn fill(&mut self, rows: impl Iterator<Item = (u8, Drops)>) -> Arc<Table> {
        self.next = (self.next + 1) % TABLES;
        let slot = &mut self.tables[self.next];
        if Arc::get_mut(slot).is_none() {
            // The disk stalls, and this one still waits for it.
            *slot = Arc::default();
        }
        if let Some(table) = Arc::get_mut(slot) {
            table.clear();
            table.extend(rows);
        }
        slot.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_table_that_somebody_holds_is_left_alone() {
        let mut shelf = Shelf::default();
        let rows = |n: u8| (0..n).map(|n| (n, Drops::default()));
        let held = shelf.fill(rows(3));
        for n in 0..9 {
            assert_eq!(shelf.fill(rows(n)).len(), usize::from(n));
        }
        assert_eq!(held.len(), 3);
    }
}
