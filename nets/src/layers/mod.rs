//! Layers, one a file, with their equations.

/// `forward` and `forward_then` of a layer whose last step may be fused with an activation.
macro_rules! forward {
    ($(#[$doc:meta])+ |$self:ident, $x:ident, $activation:ident $(, $more:ident: $type:ty)?| $body:block) => {
        $(#[$doc])+
        #[track_caller]
        pub fn forward<'t>(&$self, $x: Var<'t, F> $(, $more: $type)?) -> Var<'t, F> {
            $self.forward_then($x, $($more,)? Activation::None)
        }

        /// [`forward`](Self::forward) and an activation, in the same pass where that is possible.
        ///
        /// # Shapes
        /// As for [`forward`](Self::forward).
        #[track_caller]
        pub fn forward_then<'t>(
            &$self,
            $x: Var<'t, F>,
            $($more: $type,)?
            $activation: Activation,
        ) -> Var<'t, F> $body
    };
}

pub(crate) mod activation;
pub(crate) mod batch_norm;
pub(crate) mod conv2d;
pub(crate) mod conv3d;
pub(crate) mod conv_transpose2d;
pub(crate) mod dropout;
pub(crate) mod graph_conv;
pub(crate) mod group_norm;
pub(crate) mod indexed;
pub(crate) mod layer_norm;
pub(crate) mod linear;
pub(crate) mod mlp;
pub(crate) mod multi_head_attention;
pub(crate) mod norm;
pub(crate) mod perceptual_pooling;
pub(crate) mod point_mlp;
pub(crate) mod pooling;
pub(crate) mod transformer_encoder;
pub(crate) mod weight_norm;
