//! The server, driven with the bytes of the protocol.

mod client;
mod completion;
mod diagnostics;
mod hover;
mod life;
mod names;
mod outline;
mod robust;

use client::Client;

/// A graph of its own.
const MAIN: &str = r#"// A show.
Graph(
    pegbar: 1,
    frames: (first: 1, last: 48, fps: 24),
    clocks: { "film": (first: 1, last: 10, fps: 5) },
    params: {
        "softness": (type: "number", default: 0.25, doc: "How soft it is"),
    },
    nodes: {
        // The sky behind all.
        "sky": (type: "image.constant", size: (64, 32)),
        "hat": (type: "graph:lib/soft.ron", image: "@sky", size: "$softness"),
        "grey": (type: "image.statistics", image: "@hat.soft"),
        "comp": (type: "comp.over", fg: "@hat", bg: "@sky", opacity: 0.5),
        "out": (type: "io.write_images", image: "@comp", path: "$out/comp.####.png"),
    },
    outputs: { "image": "@comp" },
)
"#;

/// A graph for others.
const SOFT: &str = r#"Graph(
    pegbar: 1,
    doc: "Softens a picture.",
    params: {
        "image": (type: "Image", doc: "What is softened"),
        "size": (type: "any", default: 0.5, doc: "By how much"),
    },
    nodes: {
        "both": (type: "comp.over", fg: "$image", bg: "$image", opacity: "$size"),
        "blur": (type: "image.blur", image: "@both"),
    },
    outputs: { "soft": "@blur", "sharp": "@both" },
)
"#;

/// A client with a folder of both graphs, `main.ron` open.
fn shown() -> Client {
    let mut client = Client::started();
    client.write("main.ron", MAIN);
    client.write("lib/soft.ron", SOFT);
    client.open("main.ron", MAIN);
    assert_eq!(client.said("main.ron"), Vec::<String>::new());
    client
}
