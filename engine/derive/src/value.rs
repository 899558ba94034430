//! `#[derive(Value)]`.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{DeriveInput, LitStr};

use crate::attrs::{doc, fields};

#[derive(Default)]
struct StructAttrs {
    name: Option<LitStr>,
    check: Option<syn::Ident>,
    literal: Option<syn::Path>,
    form: Option<LitStr>,
}

enum FieldKind {
    Array { shape: LitStr, optional: bool },
    Text,
    Skip,
}

fn struct_attrs(input: &DeriveInput) -> syn::Result<StructAttrs> {
    let mut out = StructAttrs::default();
    for attribute in input.attrs.iter().filter(|a| a.path().is_ident("value")) {
        attribute.parse_nested_meta(|m| {
            if m.path.is_ident("name") {
                out.name = Some(m.value()?.parse()?);
            } else if m.path.is_ident("check") {
                out.check = Some(m.value()?.parse::<LitStr>()?.parse()?);
            } else if m.path.is_ident("literal") {
                out.literal = Some(m.value()?.parse::<LitStr>()?.parse()?);
            } else if m.path.is_ident("form") {
                out.form = Some(m.value()?.parse()?);
            } else {
                return Err(m.error("expected name, check, literal or form"));
            }
            Ok(())
        })?;
    }
    Ok(out)
}

fn field_kind(field: &syn::Field) -> syn::Result<FieldKind> {
    let (mut kind, mut optional) = (None, false);
    for attribute in field.attrs.iter().filter(|a| a.path().is_ident("value")) {
        attribute.parse_nested_meta(|m| {
            if m.path.is_ident("shape") {
                kind = Some(FieldKind::Array { shape: m.value()?.parse()?, optional: false });
            } else if m.path.is_ident("optional") {
                optional = true;
            } else if m.path.is_ident("text") {
                kind = Some(FieldKind::Text);
            } else if m.path.is_ident("skip") {
                kind = Some(FieldKind::Skip);
            } else {
                return Err(m.error("expected shape, optional, text or skip"));
            }
            Ok(())
        })?;
    }
    if let Some(FieldKind::Array { optional: may, .. }) = &mut kind {
        *may = optional;
    }
    kind.ok_or_else(|| syn::Error::new_spanned(field, "expected #[value(shape = \"...\")], #[value(text)] or #[value(skip)]"))
}

pub(crate) fn derive(input: &DeriveInput) -> syn::Result<TokenStream> {
    let ident = &input.ident;
    let attrs = struct_attrs(input)?;
    let name = attrs.name.map_or_else(|| ident.to_string(), |n| n.value());
    let about = doc(&input.attrs, ident, "a value type")?;
    let (mut arrays, mut texts, mut views, mut metas, mut builds, mut sizes, mut takes) =
        (vec![], vec![], vec![], vec![], vec![], vec![], vec![]);
    let (mut first, mut nths) = (None, vec![]);
    for field in fields(input)? {
        let (fname, ty) = (&field.ident, &field.ty);
        let key = fname.as_ref().map(ToString::to_string).unwrap_or_default();
        match field_kind(field)? {
            FieldKind::Array { shape, optional } => {
                let doc = doc(&field.attrs, field, "an array")?;
                first.get_or_insert(fname);
                arrays.push(quote! { ::pegbar_engine::value::ArraySchema { name: #key, dtype: <#ty as ::pegbar_engine::array::ArrayField>::DTYPE, shape: #shape, optional: #optional, doc: #doc } });
                let at = nths.len();
                nths.push(quote! { #at => Some((#key, ::pegbar_engine::array::ArrayField::view(&self.#fname))), });
                views.push(quote! { (#key, ::pegbar_engine::array::ArrayField::view(&self.#fname)) });
                takes.push(quote! { #key => ::pegbar_engine::array::ArrayField::take_block(&mut self.#fname), });
                sizes.push(quote! { ::pegbar_engine::array::ArrayField::bytes(&self.#fname).len() });
                let read = |array| {
                    quote! { ::pegbar_engine::array::ArrayField::from_array(#array)
                    .map_err(|source| ::pegbar_engine::value::ValueError::Array { name: #key, source })? }
                };
                let (given, must) = (read(quote! { array }), read(quote! { parts.take(#key)? }));
                builds.push(if optional {
                    quote! { #fname: match parts.take_optional(#key) { Some(array) => #given, None => ::core::default::Default::default() } }
                } else {
                    quote! { #fname: #must }
                });
            }
            FieldKind::Text => {
                let doc = doc(&field.attrs, field, "a text")?;
                texts.push(quote! { ::pegbar_engine::value::TextSchema { name: #key, doc: #doc } });
                metas.push(quote! { ::pegbar_engine::value::put_text(&mut meta, #key, &self.#fname); });
                builds.push(quote! { #fname: ::pegbar_engine::value::take_text(&parts.meta, #key)? });
            }
            FieldKind::Skip => builds.push(quote! { #fname: ::core::default::Default::default() }),
        }
    }
    let first_shape = first.map_or_else(
        || quote! { ::pegbar_engine::array::Shape::default() },
        |f| quote! { ::pegbar_engine::array::ArrayField::shape(&self.#f) },
    );
    let check = attrs.check.map(|c| quote! { value.#c().map_err(::pegbar_engine::value::ValueError::Invalid)?; });
    let literal = attrs.literal.map(|path| {
        let form = attrs.form;
        quote! { fn literal() -> Option<::pegbar_engine::value::LiteralSyntax<Self>> {
            Some(::pegbar_engine::value::LiteralSyntax { form: #form, parse: #path })
        } }
    });
    Ok(quote! {
        impl ::pegbar_engine::value::Value for #ident {
            const NAME: &'static str = #name;
            fn schema() -> ::pegbar_engine::value::TypeSchema {
                ::pegbar_engine::value::TypeSchema { name: #name, doc: #about, arrays: vec![#(#arrays),*], texts: vec![#(#texts),*] }
            }
            fn parts(&self) -> ::pegbar_engine::value::Parts<'_> {
                #[allow(unused_mut, reason = "a type without text fields")]
                let mut meta = ::pegbar_engine::value::Meta::new();
                #(#metas)*
                ::pegbar_engine::value::Parts { arrays: vec![#(#views),*], meta }
            }
            fn nth_array(&self, at: usize) -> Option<(&'static str, ::pegbar_engine::array::ArrayView<'_>)> {
                match at {
                    #(#nths)*
                    _ => None,
                }
            }
            fn meta(&self) -> ::pegbar_engine::value::Meta {
                #[allow(unused_mut, reason = "a type without text fields")]
                let mut meta = ::pegbar_engine::value::Meta::new();
                #(#metas)*
                meta
            }
            fn from_parts(mut parts: ::pegbar_engine::value::OwnedParts) -> Result<Self, ::pegbar_engine::value::ValueError> {
                let value = Self { #(#builds),* };
                #check
                Ok(value)
            }
            fn size(&self) -> usize {
                0 #( + #sizes)*
            }
            fn take_block(&mut self, array: &str) -> Option<Box<dyn ::pegbar_engine::array::Block>> {
                match array {
                    #(#takes)*
                    _ => None,
                }
            }
            fn first_shape(&self) -> ::pegbar_engine::array::Shape {
                #first_shape
            }
            #literal
        }
    })
}
