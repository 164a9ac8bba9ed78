//! Weights of networks.

use autodiff_lite::state::State;

pub(crate) fn weights(bytes: &[u8]) {
    if let Ok(state) = nets::weights_from_bytes(bytes) {
        let names: Vec<&str> = state.names().collect();
        for name in names {
            let _ = state.array::<f32>(name);
        }
        let _ = state.to_bytes();
    }
}

pub(crate) fn pth_seeds() -> Vec<Vec<u8>> {
    let files: [&[u8]; 3] = [
        include_bytes!("../../nets/tests/fixtures/tiny.pth"),
        include_bytes!("../../nets/tests/fixtures/tiny_old.pth"),
        include_bytes!("../../nets/tests/fixtures/checkpoint.pth"),
    ];
    files.map(<[u8]>::to_vec).to_vec()
}

pub(crate) fn safetensors_seeds() -> Vec<Vec<u8>> {
    let mut state = State::new();
    state.insert("a.weight", &[2, 3], &[1.0_f32; 6]);
    state.insert("a.bias", &[], &[0.5_f64]);
    state.insert("empty", &[0, 4], &[0.0_f32; 0]);
    state.insert_other("b.index", &[2], "I64");
    state.metadata.insert("format".to_owned(), "1".to_owned());
    vec![state.to_bytes()]
}
