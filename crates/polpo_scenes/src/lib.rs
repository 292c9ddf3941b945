//! The demo scenes, each a plugin in one file, and the harness that every example shares.
