//! Times other crates on the shapes that the benches of this workspace time.
//!
//! Prints one JSON object per line, as `peers.py` does: `{"id", "peer", "median_ms", "min_ms", "runs"}`; the id is that of the
//! criterion bench of the same work. Usage: `unsphere-peers [FAMILY..]`, of `products`, `convolutions`, `encoder`, `neighbors`
//! and `rasterizer`; how many threads work is said by `RAYON_NUM_THREADS`.

mod convolutions;
mod encoder;
mod neighbors;
mod products;
mod rasterizer;
mod timing;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let families: [(&str, fn() -> Result<(), Box<dyn std::error::Error>>); 5] = [
        ("products", products::time),
        ("convolutions", convolutions::time),
        ("encoder", encoder::time),
        ("neighbors", neighbors::time),
        ("rasterizer", rasterizer::time),
    ];
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    if let Some(name) = wanted.iter().find(|name| families.iter().all(|family| family.0 != **name))
    {
        return Err(format!("{name} is none of {:?}", families.map(|family| family.0)).into());
    }
    for (name, time) in families {
        if wanted.is_empty() || wanted.iter().any(|asked| asked == name) {
            time()?;
        }
    }
    Ok(())
}
