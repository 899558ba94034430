//! `#[derive(Setting)]`.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{Data, DeriveInput};

use crate::attrs::doc;

/// `CatmullRom` as `catmull_rom`.
fn snake(name: &str) -> String {
    let mut out = String::new();
    for (i, c) in name.chars().enumerate() {
        if c.is_uppercase() && i > 0 {
            out.push('_');
        }
        out.extend(c.to_lowercase());
    }
    out
}

pub(crate) fn derive(input: &DeriveInput) -> syn::Result<TokenStream> {
    let ident = &input.ident;
    let Data::Enum(body) = &input.data else {
        return Err(syn::Error::new_spanned(ident, "expected an enumeration"));
    };
    let (mut names, mut choices, mut variants) = (vec![], vec![], vec![]);
    for variant in &body.variants {
        let name = snake(&variant.ident.to_string());
        let doc = doc(&variant.attrs, variant, "a choice")?;
        choices.push(quote! { ::pegbar_engine::setting::Choice { name: #name, doc: #doc } });
        let v = &variant.ident;
        variants.push(quote! { #ident::#v });
        names.push(name);
    }
    let type_name = names.join(" | ");
    Ok(quote! {
        impl ::pegbar_engine::setting::Setting for #ident {
            fn type_name() -> String {
                #type_name.to_owned()
            }
            fn choices() -> Vec<::pegbar_engine::setting::Choice> {
                vec![#(#choices),*]
            }
            fn parse(text: &str) -> Result<Self, ::pegbar_engine::setting::SettingError> {
                let variants = [#(#variants),*];
                let position = ::pegbar_engine::setting::choose(text, &Self::choices())?;
                Ok(variants[position].clone())
            }
        }
    })
}
