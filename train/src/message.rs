//! What a shard's process tells the others, beside the gradient.

use autodiff_lite::{BufferUpdate, Module, Param, Tape, Updates};
use serde::{Deserialize, Serialize};

/// What a shard has beside its gradient. Numbers are bits: they arrive as they are, those that are none too.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Message {
    terms: Vec<u64>,
    /// Trainable parameters without a gradient.
    pub(super) absent: Vec<usize>,
    updates: Vec<Update>,
}

/// A buffer's update; the buffer by its place among all parameters.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct Update {
    place: usize,
    momentum: u32,
    value: Vec<u32>,
}

impl Message {
    pub(super) fn new(
        module: &impl Module<f32>,
        terms: &[(&'static str, f64)],
        updates: &Updates,
        absent: Vec<usize>,
    ) -> Self {
        let mut places = Vec::new();
        if !updates.is_empty() {
            module.visit("", &mut |_: &str, param: &Param| places.push(param.id()));
        }
        let updates = updates.iter().map(|update| Update {
            place: places.iter().position(|&id| id == update.param()).unwrap_or(usize::MAX),
            momentum: update.momentum().to_bits(),
            value: update.value().iter().map(|x| x.to_bits()).collect(),
        });
        let terms = terms.iter().map(|(_, value)| value.to_bits()).collect();
        Self { terms, absent, updates: updates.collect() }
    }

    /// The values of the weighted terms.
    pub(super) fn terms(&self) -> impl Iterator<Item = f64> {
        self.terms.iter().map(|&bits| f64::from_bits(bits))
    }

    /// The updates, of the buffers of this process; a buffer that the module does not show has none.
    pub(super) fn updates(&self, module: &impl Module<f32>, tape: &Tape) -> Updates {
        for update in &self.updates {
            let mut place = 0;
            module.visit("", &mut |_: &str, param: &Param| {
                if place == update.place {
                    let mut value = tape.buffer(update.value.len());
                    let bits = update.value.iter();
                    value.iter_mut().zip(bits).for_each(|(x, &bits)| *x = f32::from_bits(bits));
                    let momentum = f32::from_bits(update.momentum);
                    tape.push_update(BufferUpdate::new(param, value, momentum));
                }
                place += 1;
            });
        }
        tape.take_updates()
    }
}
