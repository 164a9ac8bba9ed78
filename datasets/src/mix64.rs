//! Hashes and seeds whose bits all count.

/// A bijection of 64 bits, by which each bit of `x` changes about half of the bits of the result; 0 stays 0.
///
/// The finaliser of SplitMix64: `mix64` of Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (OOPSLA 2014),
/// whose constants are those of variant 13 in Stafford's "Better bit mixing: improving on MurmurHash3's 64-bit finalizer" (2011).
/// For hashes in which the last words alone move only some bits, as they do in FNV-1a, and for seeds that are counted.
///
/// ```
/// assert_eq!(datasets::mix64(0), 0);
/// // What SplitMix64 gives first from the seed 0.
/// assert_eq!(datasets::mix64(0x9e37_79b9_7f4a_7c15), 0xe220_a839_7b1d_cdaf);
/// ```
pub fn mix64(x: u64) -> u64 {
    let x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    let x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
