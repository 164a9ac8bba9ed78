//! Layers and whole networks against those of PyTorch and torchvision, and the files of their weights; whole ones on weights
//! that both sides make by one rule (`fixtures/make_resnet.py`, `fixtures/make_mcmr.py`). One program, so that it is compiled once.
#![allow(clippy::unwrap_used, reason = "tests")]

mod goldens;
mod graph;
mod mcmr;
mod resnet;
mod rule;
mod weights;
