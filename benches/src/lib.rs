//! The benches stand in `benches/`; there is nothing to import here.
