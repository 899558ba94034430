//! Derive macros for the node and value types of `pegbar-engine`: a documented struct is all that there is to say of one.

mod attrs;
mod node;
mod setting;
mod value;

use proc_macro::TokenStream;
use syn::{DeriveInput, parse_macro_input};

/// A value type from a struct of arrays and texts.
///
/// Each field is an array, `#[value(shape = "[n, 2]")]` (with `optional` where files may leave it out); a text, `#[value(text)]` (serde, kept out of
/// files where it is the default); or a cache, `#[value(skip)]` (made by `Default`). On the struct: `#[value(check = "method")]` names a `fn(&self) -> Result<(), String>` that holds the parts
/// together, and `#[value(literal = "function", form = "text")]` lets it be written in graph files.
#[proc_macro_derive(Value, attributes(value))]
pub fn derive_value(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    value::derive(&input).unwrap_or_else(syn::Error::into_compile_error).into()
}

/// A node from a struct of inputs and settings.
///
/// On the struct: `#[node(id = "comp.over", version = 1, outputs = CompOverOutputs)]`, and where they apply `kind = sink` (`per_frame`, `recurrent`,
/// `whole`, `source`), `source = "..."`, `example = "..."`, `uses_frame`, `type_from = "input"`, `beside = function` (the files that a file names). On a field: `#[input(default = 1.0, unit = "px",
/// range = 0.0..=8.0, constant, any_clock, name = "as", window = ("-reach", "reach"))]`. Every field is documented.
#[proc_macro_derive(Node, attributes(node, input))]
pub fn derive_node(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    node::derive(&input).unwrap_or_else(syn::Error::into_compile_error).into()
}

/// The outputs of a node from a struct of documented values, the first being what `@node` means.
#[proc_macro_derive(Outputs)]
pub fn derive_outputs(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    node::derive_outputs(&input).unwrap_or_else(syn::Error::into_compile_error).into()
}

/// A setting from an enumeration of documented words: `CatmullRom` is written `catmull_rom`.
#[proc_macro_derive(Setting)]
pub fn derive_setting(input: TokenStream) -> TokenStream {
    let input = parse_macro_input!(input as DeriveInput);
    setting::derive(&input).unwrap_or_else(syn::Error::into_compile_error).into()
}
