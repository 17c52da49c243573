//! An f32 lane assembler.
