//! `#[derive(Node)]` and `#[derive(Outputs)]`.

use proc_macro2::TokenStream;
use quote::{format_ident, quote};
use syn::{DeriveInput, Expr, ExprRange, Field, LitInt, LitStr};

use crate::attrs::{doc, fields};

struct NodeAttrs {
    id: LitStr,
    version: LitInt,
    kind: String,
    outputs: Option<syn::Type>,
    source: Option<LitStr>,
    example: Option<LitStr>,
    type_from: Option<LitStr>,
    uses_frame: bool,
    beside: Option<syn::Path>,
}

fn node_attrs(input: &DeriveInput) -> syn::Result<NodeAttrs> {
    let (mut id, mut version, mut kind, mut outputs) = (None, None, "per_frame".to_owned(), None);
    let (mut source, mut example, mut type_from, mut uses_frame, mut beside) = (None, None, None, false, None);
    for attribute in input.attrs.iter().filter(|a| a.path().is_ident("node")) {
        attribute.parse_nested_meta(|m| {
            if m.path.is_ident("id") {
                id = Some(m.value()?.parse()?);
            } else if m.path.is_ident("version") {
                version = Some(m.value()?.parse()?);
            } else if m.path.is_ident("kind") {
                kind = m.value()?.parse::<syn::Ident>()?.to_string();
            } else if m.path.is_ident("outputs") {
                outputs = Some(m.value()?.parse()?);
            } else if m.path.is_ident("source") {
                source = Some(m.value()?.parse()?);
            } else if m.path.is_ident("example") {
                example = Some(m.value()?.parse()?);
            } else if m.path.is_ident("type_from") {
                type_from = Some(m.value()?.parse()?);
            } else if m.path.is_ident("uses_frame") {
                uses_frame = true;
            } else if m.path.is_ident("beside") {
                beside = Some(m.value()?.parse()?);
            } else {
                return Err(m.error("expected id, version, kind, outputs, source, example, type_from, uses_frame or beside"));
            }
            Ok(())
        })?;
    }
    let missing = |what| syn::Error::new_spanned(&input.ident, format!("expected #[node({what} = ...)], found none"));
    Ok(NodeAttrs {
        id: id.ok_or_else(|| missing("id"))?,
        version: version.ok_or_else(|| missing("version"))?,
        kind,
        outputs,
        source,
        example,
        type_from,
        uses_frame,
        beside,
    })
}

#[derive(Default)]
struct InputAttrs {
    name: Option<LitStr>,
    default: Option<String>,
    unit: Option<LitStr>,
    range: Option<(Expr, Expr)>,
    window: Option<(LitStr, LitStr)>,
    constant: bool,
    any_clock: bool,
}

/// RON text of a default as it is written in Rust: tokens apart, but no blank after a minus sign.
fn ron(expr: &Expr) -> String {
    quote!(#expr).to_string().replace("- ", "-")
}

fn bounds(range: ExprRange) -> (Expr, Expr) {
    let least = range.start.map_or_else(|| syn::parse_quote!(f64::NEG_INFINITY), |e| *e);
    let greatest = range.end.map_or_else(|| syn::parse_quote!(f64::INFINITY), |e| *e);
    (least, greatest)
}

fn input_attrs(field: &Field) -> syn::Result<InputAttrs> {
    let mut out = InputAttrs::default();
    for attribute in field.attrs.iter().filter(|a| a.path().is_ident("input")) {
        attribute.parse_nested_meta(|m| {
            if m.path.is_ident("name") {
                out.name = Some(m.value()?.parse()?);
            } else if m.path.is_ident("default") {
                out.default = Some(ron(&m.value()?.parse()?));
            } else if m.path.is_ident("unit") {
                out.unit = Some(m.value()?.parse()?);
            } else if m.path.is_ident("range") {
                out.range = Some(bounds(m.value()?.parse()?));
            } else if m.path.is_ident("window") {
                let value = m.value()?;
                let ends;
                syn::parenthesized!(ends in value);
                let first = ends.parse()?;
                ends.parse::<syn::Token![,]>()?;
                out.window = Some((first, ends.parse()?));
            } else if m.path.is_ident("constant") {
                out.constant = true;
            } else if m.path.is_ident("any_clock") {
                out.any_clock = true;
            } else {
                return Err(m.error("expected name, default, unit, range, window, constant or any_clock"));
            }
            Ok(())
        })?;
    }
    Ok(out)
}

fn option(value: Option<impl quote::ToTokens>) -> TokenStream {
    match value {
        Some(v) => quote! { Some(#v) },
        None => quote! { None },
    }
}

fn input_schema(field: &Field) -> syn::Result<TokenStream> {
    let attrs = input_attrs(field)?;
    let ty = &field.ty;
    let name = attrs.name.map_or_else(|| field.ident.as_ref().map(ToString::to_string).unwrap_or_default(), |n| n.value());
    let doc = doc(&field.attrs, field, "an input")?;
    let (default, unit) = (option(attrs.default), option(attrs.unit));
    let range = option(attrs.range.map(|(a, b)| quote! { ((#a) as f64, (#b) as f64) }));
    let window = option(attrs.window.map(|(first, last)| quote! { (#first, #last) }));
    let any_clock = attrs.any_clock;
    let access = if attrs.constant {
        quote! { ::pegbar_engine::node::Access::Constant }
    } else {
        quote! { <#ty as ::pegbar_engine::node::Input>::access() }
    };
    Ok(quote! { ::pegbar_engine::node::InputSchema {
        name: #name,
        doc: #doc,
        ty: <#ty as ::pegbar_engine::node::Input>::ty(),
        access: #access,
        window: #window,
        list: <#ty as ::pegbar_engine::node::Input>::LIST,
        optional: <#ty as ::pegbar_engine::node::Input>::OPTIONAL,
        default: #default,
        unit: #unit,
        range: #range,
        choices: <#ty as ::pegbar_engine::node::Input>::choices(),
        literal: <#ty as ::pegbar_engine::node::Input>::literal_form(),
        files: <#ty as ::pegbar_engine::node::Input>::FILES,
        any_clock: #any_clock,
        parse: ::std::sync::Arc::new(<#ty as ::pegbar_engine::node::Input>::parse),
    } })
}

pub(crate) fn derive(input: &DeriveInput) -> syn::Result<TokenStream> {
    let ident = &input.ident;
    let attrs = node_attrs(input)?;
    let about = doc(&input.attrs, ident, "a node")?;
    let fields = fields(input)?;
    let schemas = fields.iter().map(|f| input_schema(f)).collect::<syn::Result<Vec<_>>>()?;
    let names: Vec<_> = fields.iter().map(|f| &f.ident).collect();
    let kind = format_ident!(
        "{}",
        match attrs.kind.as_str() {
            "per_frame" => "PerFrame",
            "recurrent" => "Recurrent",
            "whole" => "Whole",
            "source" => "Source",
            "sink" => "Sink",
            _ => return Err(syn::Error::new_spanned(ident, "expected kind = per_frame, recurrent, whole, source or sink")),
        }
    );
    let NodeAttrs { id, version, source, example, type_from, uses_frame, outputs, beside, .. } = attrs;
    let (source, example, type_from, beside) = (option(source), option(example), option(type_from), option(beside));
    let outputs = outputs.map_or_else(|| quote! { () }, |o| quote! { #o });
    Ok(quote! {
        impl ::pegbar_engine::node::Node for #ident {
            type Outputs = #outputs;
            fn schema() -> ::pegbar_engine::node::NodeSchema {
                ::pegbar_engine::node::NodeSchema {
                    id: #id,
                    version: #version,
                    kind: ::pegbar_engine::node::Kind::#kind,
                    doc: #about,
                    source: #source,
                    example: #example,
                    uses_frame: #uses_frame,
                    beside: #beside,
                    type_from: #type_from,
                    inputs: vec![#(#schemas),*],
                    outputs: <#outputs as ::pegbar_engine::node::Outputs>::schema(),
                }
            }
            fn build(args: Vec<::pegbar_engine::node::Arg>) -> Result<Self, ::pegbar_engine::node::NodeError> {
                let mut args = args.into_iter();
                #(let #names = ::pegbar_engine::node::Input::from_arg(args.next().unwrap_or(::pegbar_engine::node::Arg::None))?;)*
                Ok(Self { #(#names),* })
            }
        }
    })
}

pub(crate) fn derive_outputs(input: &DeriveInput) -> syn::Result<TokenStream> {
    let ident = &input.ident;
    let (mut schemas, mut values) = (vec![], vec![]);
    for field in fields(input)? {
        let (name, ty) = (&field.ident, &field.ty);
        let key = name.as_ref().map(ToString::to_string).unwrap_or_default();
        let doc = doc(&field.attrs, field, "an output")?;
        schemas.push(quote! { ::pegbar_engine::node::OutputSchema {
            name: #key,
            doc: #doc,
            ty: <#ty as ::pegbar_engine::node::Output>::TYPE,
            stream: <#ty as ::pegbar_engine::node::Output>::STREAM,
        } });
        values.push(quote! { ::pegbar_engine::node::Output::into_out(self.#name) });
    }
    Ok(quote! {
        impl ::pegbar_engine::node::Outputs for #ident {
            fn schema() -> Vec<::pegbar_engine::node::OutputSchema> {
                vec![#(#schemas),*]
            }
            fn into_values(self) -> Vec<::pegbar_engine::node::OutValue> {
                vec![#(#values),*]
            }
        }
    })
}
