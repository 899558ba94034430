//! The header is what the specification says, to the letter. `PEGBAR_BLESS=header cargo test -p pegbar-abi` writes it anew.
#![allow(clippy::unwrap_used, clippy::panic, reason = "a test ends with a panic where something is wrong")]

use std::fmt::Write as _;
use std::path::Path;

use quote::ToTokens;
use syn::{Attribute, Expr, Fields, Item, Lit, Meta, Type};

/// A doc comment as lines of C.
fn doc(attributes: &[Attribute], indent: &str) -> String {
    let mut out = String::new();
    for attribute in attributes.iter().filter(|a| a.path().is_ident("doc")) {
        let Meta::NameValue(pair) = &attribute.meta else { continue };
        let Expr::Lit(literal) = &pair.value else { continue };
        let Lit::Str(text) = &literal.lit else { continue };
        let text = text.value().replace("[`", "`").replace("`]", "`").replace("::", ".");
        writeln!(out, "{}", format!("{indent}//{text}").trim_end()).unwrap();
    }
    out
}

/// `name` declared as a type, in C.
fn declare(ty: &Type, name: &str) -> String {
    match ty {
        Type::Ptr(ptr) => {
            let inner = declare(&ptr.elem, &format!("*{name}"));
            match (&ptr.elem.as_ref(), ptr.const_token) {
                (Type::Ptr(_), Some(_)) => inner.replacen(&format!("**{name}"), &format!("*const *{name}"), 1),
                (_, Some(_)) => format!("const {inner}"),
                _ => inner,
            }
        }
        Type::Array(array) => {
            let Expr::Lit(len) = &array.len else { panic!("expected a length") };
            declare(&array.elem, &format!("{name}[{}]", len.to_token_stream()))
        }
        Type::BareFn(f) => {
            let args: Vec<String> = f.inputs.iter().map(|a| declare(&a.ty, &a.name.as_ref().unwrap().0.to_string())).collect();
            let result = match &f.output {
                syn::ReturnType::Default => "void".to_owned(),
                syn::ReturnType::Type(_, ty) => declare(ty, "").trim_end().to_owned(),
            };
            format!("{result} (*{name})({})", args.join(", "))
        }
        Type::Path(path) => {
            let word = match path.path.get_ident().unwrap().to_string().as_str() {
                "u8" if name.starts_with('*') => "void".to_owned(),
                "u8" => "uint8_t".to_owned(),
                "u32" => "uint32_t".to_owned(),
                "u64" => "uint64_t".to_owned(),
                "i64" => "int64_t".to_owned(),
                "f64" => "double".to_owned(),
                other => other.to_owned(),
            };
            format!("{word} {name}")
        }
        other => panic!("expected a type that C has, found {}", other.to_token_stream()),
    }
}

fn constant(item: &syn::ItemConst) -> String {
    let name = item.ident.to_string();
    let Expr::Lit(literal) = item.expr.as_ref() else { panic!("expected a literal") };
    let value = match &literal.lit {
        Lit::Str(text) => format!("{:?}", text.value()),
        Lit::Int(n) => format!("{}u", n.to_string().replace('_', "")),
        other => panic!("expected a text or a number, found {}", other.to_token_stream()),
    };
    let name = if name == "ENTRY" { "PB_ENTRY".to_owned() } else { name };
    format!("{}#define {name} {value}\n", doc(&item.attrs, ""))
}

fn structure(item: &syn::ItemStruct) -> String {
    let Fields::Named(fields) = &item.fields else { panic!("expected named fields") };
    let mut out = format!("{}struct {} {{\n", doc(&item.attrs, ""), item.ident);
    for field in &fields.named {
        let name = field.ident.as_ref().unwrap().to_string();
        let declared = match (&field.ty, name.as_str()) {
            (Type::Ptr(_), "data") if item.ident == "PbText" => "const char *data".to_owned(),
            (ty, name) => declare(ty, name),
        };
        writeln!(out, "{}    {declared};", doc(&field.attrs, "    ")).unwrap();
    }
    out + "};\n"
}

fn header(source: &str) -> String {
    let file = syn::parse_file(source).unwrap();
    let mut out = String::from(
        "/* pegbar_plugin.h: generated from engine/abi/src/lib.rs; do not edit. C11 and C++17. */\n#ifndef PEGBAR_PLUGIN_H\n#define PEGBAR_PLUGIN_H\n\n#include <stdint.h>\n\n",
    );
    out.push_str(&doc(&file.attrs, ""));
    out.push_str("\n#ifdef __cplusplus\nextern \"C\" {\n#endif\n\n");
    for item in &file.items {
        match item {
            Item::Const(item) => out.push_str(&constant(item)),
            _ => continue,
        }
    }
    out.push('\n');
    for item in &file.items {
        let Item::Struct(item) = item else { continue };
        writeln!(out, "typedef struct {0} {0};", item.ident).unwrap();
    }
    for item in &file.items {
        if let Item::Struct(item) = item {
            write!(out, "\n{}", structure(item)).unwrap();
        }
    }
    out.push_str(include_str!("tail.h"));
    out
}

#[test]
fn the_header_is_what_the_specification_says() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = here.join("../../plugins/include/pegbar_plugin.h");
    let expected = header(&std::fs::read_to_string(here.join("src/lib.rs")).unwrap());
    if std::env::var("PEGBAR_BLESS").is_ok_and(|names| names.split(',').any(|n| n == "header" || n == "all")) {
        std::fs::write(&path, &expected).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap();
    assert!(
        found == expected,
        "plugins/include/pegbar_plugin.h is not what engine/abi/src/lib.rs says: PEGBAR_BLESS=header writes it anew"
    );
}

#[test]
fn every_struct_begins_with_its_size() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let file = syn::parse_file(&std::fs::read_to_string(here.join("src/lib.rs")).unwrap()).unwrap();
    for item in &file.items {
        let Item::Struct(item) = item else { continue };
        let first = item.fields.iter().next().and_then(|f| f.ident.as_ref()).unwrap();
        assert!(item.ident == "PbText" || first == "struct_size", "{}", item.ident);
    }
}
