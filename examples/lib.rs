//! The examples stand beside this file; there is nothing to import here.
