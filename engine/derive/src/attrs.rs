//! What the derives read: doc comments, named fields, attribute values.

use syn::spanned::Spanned;
use syn::{Attribute, Data, DeriveInput, Expr, Field, Fields, Lit, Meta};

/// The doc comment, its lines joined; an error where there is none.
pub(crate) fn doc(attributes: &[Attribute], at: &impl Spanned, what: &str) -> syn::Result<String> {
    let lines = attributes.iter().filter(|a| a.path().is_ident("doc")).filter_map(|a| match &a.meta {
        Meta::NameValue(nv) => text(&nv.value),
        _ => None,
    });
    let doc = lines.map(|l| l.strip_prefix(' ').unwrap_or(&l).to_owned()).collect::<Vec<_>>().join("\n");
    let doc = doc.trim().to_owned();
    if doc.is_empty() { Err(syn::Error::new(at.span(), format!("expected a doc comment on {what}, found none"))) } else { Ok(doc) }
}

fn text(value: &Expr) -> Option<String> {
    match value {
        Expr::Lit(lit) => match &lit.lit {
            Lit::Str(s) => Some(s.value()),
            _ => None,
        },
        _ => None,
    }
}

/// The named fields of a struct.
pub(crate) fn fields(input: &DeriveInput) -> syn::Result<Vec<&Field>> {
    match &input.data {
        Data::Struct(s) => match &s.fields {
            Fields::Named(named) => Ok(named.named.iter().collect()),
            Fields::Unit => Ok(Vec::new()),
            Fields::Unnamed(_) => Err(syn::Error::new(input.span(), "expected named fields, found a tuple struct")),
        },
        _ => Err(syn::Error::new(input.span(), "expected a struct")),
    }
}
