//! The inner-loop board: the link to it, who else speaks there, and what it last said.

pub(crate) mod link;
pub(crate) mod misplaced;
pub(crate) mod second_board;
