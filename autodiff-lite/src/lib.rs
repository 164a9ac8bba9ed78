//! autodiff-lite
