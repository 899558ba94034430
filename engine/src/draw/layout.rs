//! A layered layout, after K. Sugiyama, S. Tagawa, M. Toda, "Methods for visual understanding of hierarchical system structures", IEEE
//! Transactions on Systems, Man, and Cybernetics 11(2), 1981: layers by longest path, order within a layer by barycentres, and a bend at
//! each layer that a long wire crosses. Each sub-graph has a lane of its own, so that its box holds its nodes and no others.

use std::collections::BTreeMap;

use crate::graph::{Graph, Port};

use super::{folder, folders, short_name, sockets, type_label};

/// Height of a node's name and type.
pub(crate) const HEADER: f64 = 38.0;
/// Height of a port.
pub(crate) const ROW: f64 = 17.0;
/// Height of a line at the foot of a node.
pub(crate) const NOTE: f64 = 13.0;
const MARGIN: f64 = 24.0;
/// Between two nodes of a layer.
const GAP: f64 = 18.0;
/// Of a wire that only passes by.
const BEND_HEIGHT: f64 = 6.0;
/// Above and below the nodes of a sub-graph, for its box and name.
const LANE_PAD: f64 = 26.0;
/// A character of text, widest case, at the sizes that are drawn.
const CHAR: f64 = 6.6;
const SWEEPS: usize = 8;

pub(crate) struct Layout {
    pub(crate) width: f64,
    pub(crate) height: f64,
    /// Left, top, width, height of each node.
    pub(crate) nodes: Vec<[f64; 4]>,
    pub(crate) clusters: Vec<Cluster>,
    /// Points that a wire passes through between its ends: in and out of each layer that it crosses, by node and row.
    bends: BTreeMap<(usize, usize), Vec<[f64; 2]>>,
}

pub(crate) struct Cluster {
    pub(crate) name: String,
    pub(crate) rect: [f64; 4],
}

impl Layout {
    /// The points of the wire to row `row` of `node`, in pairs: each pair the ends of a curve.
    pub(crate) fn path(&self, node: usize, row: usize, from: Port) -> Vec<[f64; 2]> {
        let [x0, y0, w0, _] = self.nodes[from.node];
        let [x1, y1, _, _] = self.nodes[node];
        let at = |y: f64, row: usize| y + HEADER + (row as f64 + 0.5) * ROW;
        let mut points = vec![[x0 + w0, at(y0, from.output)]];
        points.extend(self.bends.get(&(node, row)).into_iter().flatten());
        points.push([x1, at(y1, row)]);
        points
    }
}

/// A node, or a bend of a wire.
struct Item {
    node: Option<usize>,
    /// For a bend: node and row that its wire goes to.
    wire: (usize, usize),
    layer: usize,
    lane: usize,
    size: [f64; 2],
    y: f64,
    /// Items of the layer before that it hangs on, and those of the layer after that hang on it.
    left: Vec<usize>,
    right: Vec<usize>,
}

/// Places everything. O((nodes + wires times layers crossed) log), but for the layers, which take O(nodes times wires) at worst.
pub(crate) fn layout(graph: &Graph, notes: &[Vec<String>]) -> Layout {
    let layers = layers(graph);
    let lanes = lanes(graph);
    let mut items = items(graph, notes, &layers, &lanes);
    let n_layers = layers.iter().max().map_or(0, |l| l + 1);
    let n_lanes = lanes.iter().max().map_or(0, |l| l + 1);
    let mut columns: Vec<Vec<usize>> = vec![Vec::new(); n_layers];
    for (i, item) in items.iter().enumerate() {
        columns[item.layer].push(i);
    }
    order(&mut columns, &items);
    let height = place_rows(&columns, &mut items, n_lanes);
    let (xs, widths, width) = place_columns(graph, &columns, &items, &layers);
    collect(graph, &items, &xs, &widths, [width, height])
}

/// The longest path from a node that reads nothing.
fn layers(graph: &Graph) -> Vec<usize> {
    let mut layers = vec![0usize; graph.nodes.len()];
    // Without a ring, the longest path is known after as many rounds as there are nodes on it.
    for _ in 0..graph.nodes.len() {
        let mut changed = false;
        for (i, node) in graph.nodes.iter().enumerate() {
            let least = sockets(node).iter().map(|s| layers[s.port.node] + 1).max().unwrap_or(0);
            changed |= least > layers[i];
            layers[i] = layers[i].max(least);
        }
        if !changed {
            break;
        }
    }
    layers
}

/// The lane of each node: that of its sub-graph, in the order of names, so that a sub-graph and those inside it are neighbours.
fn lanes(graph: &Graph) -> Vec<usize> {
    let all = folders(graph);
    graph.nodes.iter().map(|n| all.iter().position(|f| f == folder(n)).map_or(0, |i| i + 1)).collect()
}

fn text_width(text: &str) -> f64 {
    text.chars().count() as f64 * CHAR
}

fn node_size(graph: &Graph, notes: &[Vec<String>], node: usize) -> [f64; 2] {
    let notes = notes.get(node).map_or(&[][..], Vec::as_slice);
    let spec = &graph.nodes[node];
    let (sockets, outputs) = (sockets(spec), &spec.ty.schema.outputs);
    let rows = sockets.len().max(outputs.len());
    let row_width =
        |r: usize| text_width(sockets.get(r).map_or("", |s| &s.name)) + text_width(outputs.get(r).map_or("", |o| o.name)) + 34.0;
    let title = (text_width(short_name(spec)) * 1.15).max(text_width(spec.ty.schema.id)) + 20.0;
    let noted = notes.iter().map(|n| text_width(n) * 0.9 + 16.0);
    let width = (0..rows).map(row_width).chain(noted).fold(title.max(90.0), f64::max);
    [width, HEADER + rows as f64 * ROW + 6.0 + notes.len() as f64 * NOTE]
}

fn items(graph: &Graph, notes: &[Vec<String>], layers: &[usize], lanes: &[usize]) -> Vec<Item> {
    let item = |node, wire, layer, lane, size| Item { node, wire, layer, lane, size, y: 0.0, left: Vec::new(), right: Vec::new() };
    let mut items: Vec<Item> =
        (0..graph.nodes.len()).map(|i| item(Some(i), (i, 0), layers[i], lanes[i], node_size(graph, notes, i))).collect();
    for (i, node) in graph.nodes.iter().enumerate() {
        for (row, socket) in sockets(node).iter().enumerate() {
            let mut before = socket.port.node;
            for layer in layers[before] + 1..layers[i] {
                // A wire passes other layers in the lane of the main graph, unless it stays in one sub-graph.
                let lane = if lanes[i] == lanes[socket.port.node] { lanes[i] } else { 0 };
                items.push(item(None, (i, row), layer, lane, [0.0, BEND_HEIGHT]));
                let bend = items.len() - 1;
                link(&mut items, before, bend);
                before = bend;
            }
            link(&mut items, before, i);
        }
    }
    items
}

fn link(items: &mut [Item], left: usize, right: usize) {
    items[left].right.push(right);
    items[right].left.push(left);
}

/// Orders each layer by the mean position of its neighbours, from left to right and back in turns; lanes stay together.
fn order(columns: &mut [Vec<usize>], items: &[Item]) {
    let mut position = vec![0.0; items.len()];
    let renumber = |column: &[usize], position: &mut [f64]| {
        column.iter().enumerate().for_each(|(k, &i)| position[i] = k as f64 / column.len().max(1) as f64)
    };
    for column in columns.iter_mut() {
        column.sort_by_key(|&i| (items[i].lane, i));
        renumber(column, &mut position);
    }
    for sweep in 0..SWEEPS {
        let forward = sweep % 2 == 0;
        let n = columns.len();
        for k in 0..n {
            let column = &mut columns[if forward { k } else { n - 1 - k }];
            let wanted: BTreeMap<usize, f64> =
                column.iter().map(|&i| (i, barycentre(&items[i], forward, &position).unwrap_or(position[i]))).collect();
            column.sort_by(|a, b| {
                items[*a].lane.cmp(&items[*b].lane).then(wanted[a].total_cmp(&wanted[b])).then(position[*a].total_cmp(&position[*b]))
            });
            renumber(column, &mut position);
        }
    }
}

fn barycentre(item: &Item, forward: bool, position: &[f64]) -> Option<f64> {
    let neighbours = if forward { &item.left } else { &item.right };
    let sum: f64 = neighbours.iter().map(|&n| position[n]).sum();
    (!neighbours.is_empty()).then(|| sum / neighbours.len() as f64)
}

/// Gives each lane as much height as its fullest layer needs, and centres the others in it. Returns the whole height.
fn place_rows(columns: &[Vec<usize>], items: &mut [Item], n_lanes: usize) -> f64 {
    let stack = |column: &[usize], lane: usize, items: &[Item]| {
        let own: Vec<usize> = column.iter().copied().filter(|&i| items[i].lane == lane).collect();
        let height = own.iter().map(|&i| items[i].size[1] + GAP).sum::<f64>() - GAP;
        (own, height.max(0.0))
    };
    let mut top = MARGIN;
    for lane in 0..n_lanes {
        let height = columns.iter().map(|c| stack(c, lane, items).1).fold(0.0, f64::max);
        let pad = if lane == 0 { 0.0 } else { LANE_PAD };
        for column in columns {
            let (own, used) = stack(column, lane, items);
            let mut y = top + pad + (height - used) / 2.0;
            for i in own {
                items[i].y = y;
                y += items[i].size[1] + GAP;
            }
        }
        top += height + if height > 0.0 { 2.0 * pad + GAP } else { 0.0 };
    }
    top + MARGIN
}

/// Left and width of each layer, and the whole width. Between layers there is room for the widest label.
fn place_columns(graph: &Graph, columns: &[Vec<usize>], items: &[Item], layers: &[usize]) -> (Vec<f64>, Vec<f64>, f64) {
    let mut gaps = vec![60.0f64; columns.len()];
    for (i, node) in graph.nodes.iter().enumerate() {
        for socket in sockets(node) {
            gaps[layers[i]] = gaps[layers[i]].max(text_width(&type_label(graph, socket.port)) + 50.0);
        }
    }
    let widths: Vec<f64> = columns.iter().map(|c| c.iter().map(|&i| items[i].size[0]).fold(0.0, f64::max)).collect();
    let mut xs = Vec::with_capacity(columns.len());
    let mut x = MARGIN;
    for (k, width) in widths.iter().enumerate() {
        x += if k > 0 { gaps[k] } else { 0.0 };
        xs.push(x);
        x += width;
    }
    (xs, widths, (x + MARGIN).max(160.0))
}

fn collect(graph: &Graph, items: &[Item], xs: &[f64], widths: &[f64], [width, height]: [f64; 2]) -> Layout {
    let mut nodes = vec![[0.0; 4]; graph.nodes.len()];
    let mut bends: BTreeMap<(usize, usize), Vec<[f64; 2]>> = BTreeMap::new();
    for item in items {
        let (x, w) = (xs[item.layer], widths[item.layer]);
        match item.node {
            Some(node) => nodes[node] = [x + (w - item.size[0]) / 2.0, item.y, item.size[0], item.size[1]],
            None => {
                let y = item.y + item.size[1] / 2.0;
                bends.entry(item.wire).or_default().extend([[x, y], [x + w, y]]);
            }
        }
    }
    let clusters = folders(graph).into_iter().filter_map(|name| cluster(graph, &nodes, name)).collect();
    Layout { width, height, nodes, clusters, bends }
}

/// The box around a sub-graph and those inside it; the deeper, the closer.
fn cluster(graph: &Graph, nodes: &[[f64; 4]], name: String) -> Option<Cluster> {
    let depth = name.matches('/').count() as f64;
    let inside = |n: &str| n == name || n.strip_prefix(name.as_str()).is_some_and(|rest| rest.starts_with('/'));
    let rects = graph.nodes.iter().zip(nodes).filter(|(n, _)| inside(folder(n))).map(|(_, r)| *r);
    let [left, top, right, bottom] =
        rects.map(|[x, y, w, h]| [x, y, x + w, y + h]).reduce(|a, b| [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])])?;
    let pad = (12.0 - 3.0 * depth).max(4.0);
    Some(Cluster { name, rect: [left - pad, top - pad - 10.0, right - left + 2.0 * pad, bottom - top + 2.0 * pad + 10.0] })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::check::{LoadOptions, load_text};
    use crate::tests::nodes::registry;

    fn graph(nodes: &str) -> Graph {
        let text = format!("Graph(pegbar: 1, frames: (first: 1, last: 8, fps: 24), nodes: {{ {nodes} }})");
        let loaded = load_text(Path::new("test.ron"), &text, &registry(), &LoadOptions::default());
        loaded.graph.unwrap()
    }

    fn wide() -> Graph {
        graph(
            r#""f": (type: "test.frame"), "a": (type: "test.add", a: "@f"), "b": (type: "test.add", a: "@a", b: "@f"),
               "c": (type: "test.add", a: "@b", b: "@f"), "out": (type: "test.sink", streams: ["@c", "@f", "@a"])"#,
        )
    }

    #[test]
    fn every_wire_leads_to_the_right_and_no_two_nodes_meet() {
        let mut graph = wide();
        graph.nodes[1].name = "sub/a".to_owned();
        graph.nodes[2].name = "sub/deep/b".to_owned();
        let layout = layout(&graph, &[]);
        for (i, node) in graph.nodes.iter().enumerate() {
            for (row, socket) in sockets(node).iter().enumerate() {
                let path = layout.path(i, row, socket.port);
                assert!(path.len().is_multiple_of(2) && path.windows(2).all(|p| p[0][0] < p[1][0]), "{path:?}");
            }
        }
        let meet = |a: &[f64; 4], b: &[f64; 4]| a[0] < b[0] + b[2] && b[0] < a[0] + a[2] && a[1] < b[1] + b[3] && b[1] < a[1] + a[3];
        for (i, a) in layout.nodes.iter().enumerate() {
            assert!(a[0] >= 0.0 && a[1] >= 0.0 && a[0] + a[2] <= layout.width && a[1] + a[3] <= layout.height);
            assert!(layout.nodes[..i].iter().all(|b| !meet(a, b)), "node {i}");
            for cluster in &layout.clusters {
                let inside = graph.nodes[i].name.starts_with(&format!("{}/", cluster.name));
                assert_eq!(meet(a, &cluster.rect), inside, "node {i} and {}", cluster.name);
            }
        }
        assert_eq!(layout.clusters.len(), 2);
    }

    #[test]
    fn drawings_name_every_node_and_type_and_are_the_same_each_time() {
        let graph = wide();
        let (svg, dot) = (super::super::svg(&graph), super::super::dot(&graph));
        assert_eq!((&svg, &dot), (&super::super::svg(&graph), &super::super::dot(&graph)));
        assert_eq!(svg.matches("<path ").count(), 8);
        assert_eq!(dot.matches(" -> ").count(), 8);
        assert_eq!(svg.matches(">Curve*</text>").count(), 8);
        for drawn in [">out</text>", ">test.sink</text>", ">streams[1]</text>", ">c</text>"] {
            assert!(svg.contains(drawn), "{drawn}");
        }
        assert!(dot.contains("n0:o0:e -> n1:i0:w [label=\"Curve*\"];"));
    }

    #[test]
    fn a_graph_without_nodes_is_an_empty_picture() {
        assert!(super::super::svg(&Graph::default()).ends_with("</svg>\n"));
        assert!(super::super::dot(&Graph::default()).ends_with("}\n"));
    }
}
