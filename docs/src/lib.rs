#![doc = include_str!(concat!(env!("OUT_DIR"), "/pages/docs/README.md"))]
// Pages are written for people who read files: what stands in brackets there is seldom an item of ours.
#![allow(rustdoc::broken_intra_doc_links, rustdoc::bare_urls, reason = "pages, not items")]

include!(concat!(env!("OUT_DIR"), "/book.rs"));
