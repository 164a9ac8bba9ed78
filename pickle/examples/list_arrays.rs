//! Lists the arrays of a pickle: where they are, and their shapes.
//!
//! `cargo run -p unsphere-pickle --example list_arrays -- [file]`; without a file, a small pickle of its own.

use std::io::Write;

use pickle::{Item, Pickle};

/// `pickle.dumps([[1.5, 2.5], "a"], 2)`
const SAMPLE: &[u8] = b"\x80\x02](](G?\xf8\0\0\0\0\0\0G@\x04\0\0\0\0\0\0eU\x01ae.";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let bytes = std::env::args().nth(1).map(std::fs::read).transpose()?;
    let pickle = Pickle::parse(bytes.as_deref().unwrap_or(SAMPLE))?;
    let mut out = std::io::stdout().lock();
    let mut pending = vec![pickle.root()];
    while let Some(item) = pending.pop() {
        if item.is_array() {
            let shape = item.numbers()?.shape;
            writeln!(out, "{}: an array {shape:?}", item.field)?;
        } else {
            let parts = elements(&item);
            writeln!(out, "{}: {} parts", item.field, parts.len())?;
            pending.extend(parts);
        }
    }
    Ok(())
}

/// The elements of a list or tuple of at most 16; nothing for anything else.
fn elements<'p, 'a>(item: &Item<'p, 'a>) -> Vec<Item<'p, 'a>> {
    (1..=16).find_map(|count| item.elements(count).ok()).unwrap_or_default()
}
