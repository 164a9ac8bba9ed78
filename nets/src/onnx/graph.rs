//! A graph under construction, and the model that it becomes.

use std::collections::BTreeMap;

use prost::Message;

use super::proto::{
    Attribute, Dimension, FLOAT, Graph, INT64, Model, Node, OperatorSet, Shape, Tensor, TensorType,
    ValueInfo, ValueType,
};

/// The version of the operators.
const OPSET: i64 = 17;
/// The version of the file format that came with them.
const IR: i64 = 8;
/// What the first axis of all inputs and outputs is called.
const BATCH: &str = "batch";

/// A value in a graph: an input, or what a node gives.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OnnxValue {
    /// Its name in the graph.
    pub name: String,
    /// Its axes behind the first, which is the batch.
    pub shape: Vec<usize>,
}

impl OnnxValue {
    /// Channels, rows and columns.
    ///
    /// # Panics
    /// If it is no image.
    #[track_caller]
    pub(super) fn image(&self) -> [usize; 3] {
        let shape = &self.shape[..];
        shape.try_into().unwrap_or_else(|_| panic!("[N, C, H, W] expected, found [N, {shape:?}]"))
    }
}

/// A graph that inputs, nodes and outputs are added to. Nodes stand in the order in which they are computed.
#[derive(Debug)]
pub struct OnnxGraph {
    graph: Graph,
    path: Vec<String>,
    /// How often each name was given.
    given: BTreeMap<String, usize>,
    inputs: Vec<OnnxValue>,
    outputs: Vec<OnnxValue>,
}

impl OnnxGraph {
    /// An empty graph of a name.
    pub fn new(name: &str) -> Self {
        let graph = Graph { name: name.to_owned(), ..Graph::default() };
        let (given, inputs, outputs) = (BTreeMap::new(), Vec::new(), Vec::new());
        Self { graph, path: Vec::new(), given, inputs, outputs }
    }

    /// An input `[N, ..shape]`.
    ///
    /// # Panics
    /// If there is one of the name.
    pub fn input(&mut self, name: &str, shape: &[usize]) -> OnnxValue {
        let value = OnnxValue { name: name.to_owned(), shape: shape.to_vec() };
        assert!(self.given.insert(name.to_owned(), 1).is_none(), "two inputs called {name}");
        self.graph.input.push(info(&value));
        self.inputs.push(value.clone());
        value
    }

    /// Makes a value an output, under a name of its own.
    ///
    /// # Panics
    /// If there is an input or output of the name.
    pub fn output(&mut self, name: &str, value: &OnnxValue) {
        assert!(self.given.insert(name.to_owned(), 1).is_none(), "two values called {name}");
        let named = OnnxValue { name: name.to_owned(), shape: value.shape.clone() };
        self.graph.node.push(Node {
            input: vec![value.name.clone()],
            output: vec![name.to_owned()],
            name: format!("{name}/Identity"),
            op_type: "Identity".to_owned(),
            attribute: Vec::new(),
        });
        self.graph.output.push(info(&named));
        self.outputs.push(named);
    }

    /// Names what is added meanwhile: weights are called as in state dicts, with slashes.
    pub fn scope<R>(&mut self, name: &str, add: impl FnOnce(&mut Self) -> R) -> R {
        self.path.push(name.to_owned());
        let added = add(self);
        self.path.pop();
        added
    }

    /// The model.
    pub fn finish(self) -> OnnxModel {
        let Self { graph, inputs, outputs, .. } = self;
        let model = Model {
            ir_version: IR,
            producer_name: "unsphere".to_owned(),
            producer_version: env!("CARGO_PKG_VERSION").to_owned(),
            graph: Some(graph),
            opset_import: vec![OperatorSet { domain: String::new(), version: OPSET }],
        };
        OnnxModel { model, inputs, outputs }
    }

    /// A name below the present path that nothing has yet.
    fn named(&mut self, name: &str) -> String {
        let path = self.path.iter().map(String::as_str).chain([name]).collect::<Vec<_>>().join("/");
        let count = self.given.entry(path.clone()).or_insert(0);
        *count += 1;
        if *count == 1 { path } else { format!("{path}_{count}") }
    }

    /// Constant numbers, under their name.
    pub(super) fn constant(&mut self, name: &str, shape: &[usize], values: &[f32]) -> String {
        assert_eq!(shape.iter().product::<usize>(), values.len(), "{name}: {shape:?}");
        let raw_data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.initializer(name, shape, FLOAT, raw_data)
    }

    /// Constant whole numbers: a shape, places.
    pub(super) fn integers(&mut self, name: &str, values: &[i64]) -> String {
        let raw_data = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        self.initializer(name, &[values.len()], INT64, raw_data)
    }

    fn initializer(
        &mut self,
        name: &str,
        shape: &[usize],
        data_type: i32,
        raw_data: Vec<u8>,
    ) -> String {
        let name = self.named(name);
        let dims = shape.iter().map(|&dim| dim as i64).collect();
        self.graph.initializer.push(Tensor { dims, data_type, name: name.clone(), raw_data });
        name
    }

    /// An operator of inputs by their names, whose one output has this shape.
    pub(super) fn node(
        &mut self,
        op: &str,
        inputs: &[&str],
        attribute: Vec<Attribute>,
        shape: &[usize],
    ) -> OnnxValue {
        let name = self.named(op);
        // Nodes and values have names of one kind in some runtimes.
        let value = OnnxValue { name: format!("{name}_output"), shape: shape.to_vec() };
        self.graph.node.push(Node {
            input: inputs.iter().map(|&input| input.to_owned()).collect(),
            output: vec![value.name.clone()],
            name,
            op_type: op.to_owned(),
            attribute,
        });
        value
    }
}

fn info(value: &OnnxValue) -> ValueInfo {
    let batch = Dimension { param: Some(BATCH.to_owned()), value: None };
    let known = value.shape.iter().map(|&n| Dimension { value: Some(n as i64), param: None });
    let shape = Some(Shape { dim: std::iter::once(batch).chain(known).collect() });
    let tensor = Some(TensorType { elem_type: FLOAT, shape });
    ValueInfo { name: value.name.clone(), kind: Some(ValueType { tensor }) }
}

/// A graph that is complete.
#[derive(Clone, Debug)]
pub struct OnnxModel {
    model: Model,
    /// What it takes: names, and axes behind the batch.
    pub inputs: Vec<OnnxValue>,
    /// What it gives.
    pub outputs: Vec<OnnxValue>,
}

impl OnnxModel {
    /// The file.
    pub fn to_bytes(&self) -> Vec<u8> {
        self.model.encode_to_vec()
    }

    /// How many operators it has, and how many numbers of weights.
    pub fn size(&self) -> (usize, usize) {
        let graph = self.model.graph.as_ref();
        let floats = graph.into_iter().flat_map(|graph| &graph.initializer);
        let floats = floats.filter(|tensor| tensor.data_type == FLOAT);
        let numbers = floats.map(|tensor| tensor.raw_data.len() / 4).sum();
        (graph.map_or(0, |graph| graph.node.len()), numbers)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::collections::BTreeSet;

    use autodiff_lite::Activation;

    use super::*;
    use crate::onnx::ToOnnx;
    use crate::{Init, Mlp, ResNet, ResNetConfig};

    /// Reads a model back and sees that each value is there before it is used, and once.
    fn check(model: &OnnxModel) -> Graph {
        let read = Model::decode(&model.to_bytes()[..]).unwrap();
        assert_eq!((read.ir_version, read.opset_import[0].version), (8, 17));
        let graph = read.graph.unwrap();
        let mut known: BTreeSet<&str> = BTreeSet::from([""]);
        let constants = graph.initializer.iter().map(|tensor| &tensor.name);
        for name in graph.input.iter().map(|input| &input.name).chain(constants) {
            assert!(known.insert(name), "{name} is there twice");
        }
        for node in &graph.node {
            for input in &node.input {
                assert!(known.contains(input.as_str()), "{input} of {} is not there", node.name);
            }
            for output in &node.output {
                assert!(known.insert(output), "{output} is there twice");
            }
        }
        graph.output.iter().for_each(|output| assert!(known.contains(output.name.as_str())));
        graph
    }

    #[test]
    fn graphs_are_in_order_and_names_are_unique() {
        let mut graph = OnnxGraph::new("two");
        let x = graph.input("x", &[8]);
        let mlp = Mlp::<f32>::new(&Init::new(0), &[8, 4, 3], Activation::Relu);
        let y = graph.scope("one", |graph| mlp.to_onnx(graph, &x));
        let z = graph.scope("one", |graph| mlp.to_onnx(graph, &x));
        let sum = graph.add(&y, &z);
        graph.output("y", &sum);
        let model = graph.finish();
        let graph = check(&model);
        let dims = &graph.output[0].kind.as_ref().unwrap().tensor.as_ref().unwrap().shape;
        let dims = &dims.as_ref().unwrap().dim;
        assert_eq!(dims[0].param.as_deref(), Some("batch"));
        assert_eq!((dims.len(), dims[1].value), (2, Some(3)));
        assert!(graph.initializer.iter().any(|tensor| tensor.name == "one/layers/0/weight"));
        assert_eq!(model.size().1, 2 * (8 * 4 + 4 + 4 * 3 + 3));
    }

    #[test]
    fn a_deep_network_has_all_its_weights() {
        let config = ResNetConfig { width: 8, classes: Some(5), ..ResNetConfig::resnet18() };
        let net = ResNet::<f32>::new(&Init::new(0), &config);
        let mut graph = OnnxGraph::new("resnet");
        let image = graph.input("image", &[3, 64, 48]);
        let maps = net.to_onnx(&mut graph, &image);
        assert_eq!(maps[3].shape, [64, 2, 2]);
        graph.output("map", &maps[3]);
        check(&graph.finish());
    }
}
