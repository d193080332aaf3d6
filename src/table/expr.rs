//! Expressions over the columns of a table, as programs for a stack of numbers: evaluation and
//! destruction take no recursion, however long the text is.

use super::column::Column;
use super::parse;
use super::reader::Row;
use crate::error::{Error, Result};

/// What an expression says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A number.
    Number,
    /// True or false.
    Condition,
}

/// One step of a program. A missing number is NaN; conditions are 0 and 1.
#[derive(Debug, Clone, Copy)]
pub(super) enum Op {
    Push(f64),
    /// The number in a column.
    Column(usize),
    /// The condition in a column; a missing one is false.
    Flag(usize),
    Negate,
    Not,
    Missing,
    Unary(fn(f64) -> f64),
    Binary(fn(f64, f64) -> f64),
}

/// An expression that has been checked against the columns of a table. See the module for the
/// language.
#[derive(Debug, Clone)]
pub struct Expr {
    text: String,
    kind: Kind,
    program: Vec<Op>,
}

impl Expr {
    /// Reads a condition, such as `volume > 0.5 and not touches_border`. `option` is named in errors.
    ///
    /// # Errors
    /// [`Error::Usage`] with the column of the text at which something else was expected.
    pub fn condition(option: &str, text: &str, columns: &[Column]) -> Result<Expr> {
        let expr = Self::any(option, text, columns)?;
        if expr.kind == Kind::Condition {
            return Ok(expr);
        }
        Err(Error::usage(
            option,
            format!("the number `{}`", parse::short(text)),
            "a condition, such as volume > 0.5",
        ))
    }

    /// Reads a number, such as `area / volume`; a condition counts as 0 or 1.
    ///
    /// # Errors
    /// As [`Expr::condition`].
    pub fn number(option: &str, text: &str, columns: &[Column]) -> Result<Expr> {
        Self::any(option, text, columns)
    }

    fn any(option: &str, text: &str, columns: &[Column]) -> Result<Expr> {
        let (program, kind) = parse::program(text, columns).map_err(|r| r.error(option, text))?;
        Ok(Expr {
            text: text.to_string(),
            kind,
            program,
        })
    }

    /// The text that was read.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Number or condition.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// True if the condition holds for a row.
    ///
    /// # Errors
    /// Those of [`Row::number`].
    pub fn test(&self, row: &Row) -> Result<bool> {
        Ok(self.value(row)? == Some(1.0))
    }

    /// The value for a row, or `None` if it is missing.
    ///
    /// # Errors
    /// Those of [`Row::number`].
    pub fn value(&self, row: &Row) -> Result<Option<f64>> {
        let value = run(&self.program, |column| row.number(column))?;
        Ok(Some(value).filter(|v| !v.is_nan()))
    }
}

/// Runs a program with the values of columns.
pub(super) fn run(
    program: &[Op],
    mut get: impl FnMut(usize) -> Result<Option<f64>>,
) -> Result<f64> {
    let mut stack: Vec<f64> = Vec::with_capacity(8);
    for op in program {
        let value = match *op {
            Op::Push(v) => v,
            Op::Column(c) => get(c)?.unwrap_or(f64::NAN),
            Op::Flag(c) => truth(get(c)?.is_some_and(|v| v != 0.0)),
            Op::Binary(f) => {
                let b = stack.pop().unwrap_or(f64::NAN);
                let a = stack.pop().unwrap_or(f64::NAN);
                f(a, b)
            }
            Op::Negate | Op::Not | Op::Missing | Op::Unary(_) => {
                let a = stack.pop().unwrap_or(f64::NAN);
                match *op {
                    Op::Negate => -a,
                    Op::Not => truth(a == 0.0),
                    Op::Missing => truth(a.is_nan()),
                    Op::Unary(f) => finite(f(a)),
                    _ => f64::NAN,
                }
            }
        };
        stack.push(value);
    }
    Ok(stack.pop().unwrap_or(f64::NAN))
}

/// A result that is not finite is missing.
fn finite(v: f64) -> f64 {
    if v.is_finite() { v } else { f64::NAN }
}

fn truth(b: bool) -> f64 {
    f64::from(u8::from(b))
}

/// The step of an operator between two values, which both must be of the kind returned. `None` for
/// other symbols.
pub(super) fn operator(symbol: &str) -> Option<fn(f64, f64) -> f64> {
    Some(match symbol {
        "+" => |a, b| finite(a + b),
        "-" => |a, b| finite(a - b),
        "*" => |a, b| finite(a * b),
        "/" => |a, b| finite(a / b),
        // pow(NaN, 0) and pow(1, NaN) are 1, but what is missing stays so
        "^" => |a, b| {
            if a.is_nan() || b.is_nan() {
                f64::NAN
            } else {
                finite(libm::pow(a, b))
            }
        },
        "<" => |a, b| truth(a < b),
        "<=" => |a, b| truth(a <= b),
        ">" => |a, b| truth(a > b),
        ">=" => |a, b| truth(a >= b),
        "==" | "=" => |a, b| truth(a == b),
        "!=" => |a, b| truth(!a.is_nan() && !b.is_nan() && a != b),
        "and" => |a, b| truth(a == 1.0 && b == 1.0),
        "or" => |a, b| truth(a == 1.0 || b == 1.0),
        "min" => |a, b| {
            if a.is_nan() || b.is_nan() {
                f64::NAN
            } else {
                a.min(b)
            }
        },
        "max" => |a, b| {
            if a.is_nan() || b.is_nan() {
                f64::NAN
            } else {
                a.max(b)
            }
        },
        _ => return None,
    })
}

/// The step of a function of one value.
pub(super) fn function(name: &str) -> Option<fn(f64) -> f64> {
    Some(match name {
        "abs" => f64::abs,
        "sqrt" => f64::sqrt,
        "cbrt" => libm::cbrt,
        "exp" => libm::exp,
        "log" => libm::log,
        "log10" => libm::log10,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn columns() -> Vec<Column> {
        ["id", "v", "w", "touches_border", "gone"]
            .map(|name| Column {
                name: name.into(),
                unit: if name == "v" { "mm^3" } else { "" }.into(),
            })
            .to_vec()
    }

    /// The value for v = 3, w = -2, touches_border = 1 and nothing in `gone`.
    fn value(text: &str) -> Option<f64> {
        let expr = Expr::number("--where", text, &columns()).unwrap();
        let row = [Some(7.0), Some(3.0), Some(-2.0), Some(1.0), None];
        let v = run(&expr.program, |c| Ok(row[c])).unwrap();
        Some(v).filter(|v| !v.is_nan())
    }

    fn refusal(text: &str) -> String {
        Expr::condition("--where", text, &columns())
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn arithmetic_binds_as_in_school() {
        for (text, expected) in [
            ("1 + 2 * 3", 7.0),
            ("(1 + 2) * 3", 9.0),
            ("10 - 4 - 3", 3.0),
            ("16 / 4 / 2", 2.0),
            ("-2^2", -4.0),
            ("2^3^2", 512.0),
            ("2^-1", 0.5),
            ("--3", 3.0),
            ("2 * -v", -6.0),
            ("abs(w) + sqrt(v + 1) + cbrt(8)", 6.0),
            ("min(v, w, 1) - max(v, w)", -5.0),
            ("log(exp(2)) + log10(1000)", 5.0),
            ("1.5e1", 15.0),
        ] {
            assert_eq!(value(text), Some(expected), "{text}");
        }
    }

    #[test]
    fn conditions_combine() {
        for (text, expected) in [
            ("v > 2 and w < 0", true),
            ("v > 2 && w > 0 || v = 3", true),
            ("v > 2 and (w > 0 or v != 3)", false),
            ("not v > 2 or true", true),
            ("not (v > 2 or true)", false),
            ("! ! touches_border", true),
            ("touches_border == 1 and touches_border != false", true),
            ("touches_border = 0", false),
            ("v <= 3 and v >= 3 and v == 3 and not (v < 3)", true),
            ("(v > w) == (w < v)", true),
            ("v [mm^3] > 2 AND NOT w > 0 Or FALSE", true),
            ("v[mm^3]*v + w*w < 14 and v - w == 5 AND True", true),
            ("v*v + w*w < 14 and v - w == 5", true),
        ] {
            assert_eq!(value(text), Some(f64::from(u8::from(expected))), "{text}");
        }
    }

    #[test]
    fn missing_values_compare_as_false() {
        for text in [
            "gone",
            "gone + 1",
            "-gone",
            "1 / 0",
            "sqrt(w)",
            "log(0)",
            "min(1, gone)",
            "max(gone, 1)",
            "gone ^ 0",
            "1 ^ gone",
            "10^400 - 10^400",
        ] {
            assert_eq!(value(text), None, "{text}");
            for operator in ["<", "<=", ">", ">=", "==", "!="] {
                assert_eq!(
                    value(&format!("{text} {operator} 1")),
                    Some(0.0),
                    "{text} {operator}"
                );
                assert_eq!(
                    value(&format!("1 {operator} {text}")),
                    Some(0.0),
                    "{text} {operator}"
                );
            }
            assert_eq!(value(&format!("missing({text})")), Some(1.0), "{text}");
        }
        assert_eq!(value("not (gone < 1)"), Some(1.0));
        assert_eq!(value("missing(v) or missing(touches_border)"), Some(0.0));
    }

    #[test]
    fn refusals_say_where_and_what_was_expected() {
        for (text, parts) in [
            ("", &["the end at column 1", "a number, a column"][..]),
            ("v >", &["the end at column 4", "a number"]),
            (
                "volme > 3",
                &["`volme` at column 1", "id, v, w, touches_border, gone"],
            ),
            ("touches > 3", &["did you mean `touches_border`?"]),
            ("Gon > 3", &["did you mean `gone`?"]),
            (
                "v [mm^2] > 3",
                &["`[mm^2]` at column 3", "[mm^3], the unit of v"],
            ),
            ("w [mm] > 3", &["no unit after w"]),
            ("v > 3 [mm^3]", &["`[mm^3]` at column 7"]),
            ("AND > 2", &["`AND` at column 1", "a number"]),
            ("v > 3 and", &["column 10"]),
            ("v > 3 w", &["`w` at column 7", "and"]),
            ("v < w < 3", &["`<` at column 7", "do not chain"]),
            ("v + 1", &["the number `v + 1`", "a condition"]),
            ("v and w > 1", &["the number", "column 1", "a condition"]),
            (
                "1 + (v > 2) > 0",
                &["the condition", "column 5", "a number"],
            ),
            ("not v", &["column 5", "a condition"]),
            ("(v > 2", &["the end at column 7", "`)`"]),
            ("sqrt v > 2", &["`v` at column 6", "`(`"]),
            ("min(v) > 2", &["`)` at column 6", "`,`"]),
            ("v > 1e999", &["column 5", "10^308"]),
            ("v ? 2", &["`?` at column 3"]),
            ("µ > 2 ? 1", &["`µ` at column 1"]),
            ("v < true", &["column 5", "a number"]),
            ("and > 2", &["`and` at column 1"]),
        ] {
            let message = refusal(text);
            assert!(message.starts_with("--where: found "), "{message}");
            for part in parts {
                assert!(message.contains(part), "{text}: {message}");
            }
        }
    }

    #[test]
    fn hostile_texts_do_not_overflow_the_stack() {
        let many = 1900;
        for text in [
            "(".repeat(many) + "v" + &")".repeat(many) + " > 1",
            "2^".repeat(many) + "1 > 1",
            "abs(".repeat(many) + "v" + &")".repeat(many) + " > 1",
        ] {
            assert!(refusal(&text).contains("100 levels"), "{}", refusal(&text));
        }
        assert!(refusal(&"v".repeat(100_000)).contains("10000"));
        assert_eq!(value(&("not ".repeat(2000) + "v > 2")), Some(1.0));
        assert_eq!(value(&("-".repeat(2001) + "v")), Some(-3.0));
        assert_eq!(value(&("0".to_string() + &"+1".repeat(4000))), Some(4000.0));
    }

    proptest! {
        #[test]
        fn no_text_panics(text in ".{0,40}") {
            let _ = Expr::condition("--where", &text, &columns()).map_err(|e| e.to_string());
        }

        #[test]
        fn no_order_of_words_panics(words in prop::collection::vec(
            prop::sample::select(vec!["v", "w", "gone", "touches_border", "(", ")", "and", "or",
                "not", "<", "!=", "=", "+", "-", "*", "/", "^", ",", "min", "sqrt", "missing", "1",
                "0", "true", "1e300", "µ"]), 0..16)) {
            let text = words.join(" ");
            if let Ok(expr) = Expr::number("--where", &text, &columns()) {
                let row = [Some(7.0), Some(3.0), Some(-2.0), Some(1.0), None];
                let v = run(&expr.program, |c| Ok(row[c])).unwrap();
                prop_assert!(v.is_finite() || v.is_nan());
                if expr.kind == Kind::Condition {
                    prop_assert!(v == 0.0 || v == 1.0, "{} gives {}", text, v);
                }
            }
        }
    }
}
