//! The page's modules as one script.
//!
//! A browser asks for each module by itself, six at a time, before it runs the first: with some thirty that takes longer
//! than all that comes after it until there is a picture. Each module becomes a function that is called once and returns
//! what the module exports. Only the forms that the page uses are known, each on one line: `import { a, b as c } from
//! "./x.js";` and `export` before a const, class or function.

use std::collections::BTreeMap;
use std::fmt::Write;

/// The script of a module and all that it imports, directly or not.
///
/// # Errors
/// The line that is of no known form, or imports what is not there or what imports it.
pub fn bundle(modules: &BTreeMap<&str, &str>, main: &str) -> Result<String, String> {
    let mut script = "\"use strict\";\n".to_owned();
    add(modules, main, &mut Vec::new(), &mut Vec::new(), &mut script)?;
    Ok(script)
}

/// Appends a module behind those that it imports; `open` are those that wait for it.
fn add<'a>(
    modules: &BTreeMap<&'a str, &'a str>,
    name: &'a str,
    open: &mut Vec<&'a str>,
    done: &mut Vec<&'a str>,
    script: &mut String,
) -> Result<(), String> {
    if done.contains(&name) {
        return Ok(());
    }
    let text = modules.get(name).filter(|_| !open.contains(&name));
    let text = text.ok_or_else(|| format!("{name} is missing, or imports itself: {open:?}"))?;
    open.push(name);
    let mut body = String::new();
    let mut exported = Vec::new();
    for line in text.lines() {
        let unknown = || format!("{name}: {line}");
        if let Some(rest) = line.strip_prefix("import ") {
            let (names, from) = imported(rest).ok_or_else(unknown)?;
            add(modules, from, open, done, script)?;
            let names = names.replace(" as ", ": ");
            body += &format!("const {names} = {};\n", variable(from));
        } else if let Some(rest) = line.strip_prefix("export ") {
            exported.push(declared(rest).ok_or_else(unknown)?);
            body += rest;
            body.push('\n');
        } else {
            body += line;
            body.push('\n');
        }
    }
    open.pop();
    done.push(name);
    let (own, exported) = (variable(name), exported.join(", "));
    write!(
        script,
        "const {own} = (() => {{\n{body}return {{ {exported} }};\n}})();\n"
    )
    .map_err(|e| e.to_string())
}

fn variable(module: &str) -> String {
    format!("${}", module.trim_end_matches(".js"))
}

/// Names in braces and the module of `{ a, b as c } from "./x.js";`.
fn imported(rest: &str) -> Option<(&str, &str)> {
    let (names, from) = rest.split_once(" from \"./")?;
    let from = from.strip_suffix("\";")?;
    (names.starts_with("{ ") && names.ends_with(" }")).then_some((names, from))
}

/// The name that a line behind `export` declares.
fn declared(rest: &str) -> Option<&str> {
    let kinds = ["const ", "class ", "function ", "async function "];
    let rest = kinds.iter().find_map(|kind| rest.strip_prefix(kind))?;
    rest.split(|c: char| !c.is_alphanumeric() && c != '_')
        .next()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bundled(modules: &[(&'static str, &'static str)]) -> Result<String, String> {
        bundle(&modules.iter().copied().collect(), "main.js")
    }

    #[test]
    fn modules_come_once_and_behind_what_they_import() {
        let script = bundled(&[
            (
                "main.js",
                "import { a } from \"./a.js\";\nimport { b as c } from \"./b.js\";\na(c);",
            ),
            (
                "a.js",
                "import { b } from \"./b.js\";\nexport function a(x) {\n  return b + x;\n}",
            ),
            ("b.js", "export const b = 1;"),
        ]);
        let expected = "\"use strict\";\n\
            const $b = (() => {\nconst b = 1;\nreturn { b };\n})();\n\
            const $a = (() => {\nconst { b } = $b;\nfunction a(x) {\n  return b + x;\n}\nreturn { a };\n})();\n\
            const $main = (() => {\nconst { a } = $a;\nconst { b: c } = $b;\na(c);\nreturn {  };\n})();\n";
        assert_eq!(script.as_deref(), Ok(expected));
    }

    #[test]
    fn what_is_not_understood_is_an_error() {
        for bad in [
            "import a from \"./main.js\";",
            "import { a } from \"./none.js\";",
            "import { a } from \"./main.js\";",
            "import {",
            "export default 1;",
            "export { a };",
        ] {
            assert!(bundled(&[("main.js", bad)]).is_err(), "{bad}");
        }
    }
}
