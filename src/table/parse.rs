//! The grammar of expressions: words to a program, by descent along the precedences.

use super::column::{Column, did_you_mean, names};
use super::expr::{Kind, Op, function, operator};
use super::lex::{Token, tokens};
use crate::error::Error;

/// The longest text in bytes, and the deepest nesting of parentheses and powers.
const LONGEST: usize = 10_000;
const DEEPEST: usize = 100;
/// Characters of a text that a message repeats.
const SHOWN: usize = 60;

const OPERAND: &str = "a number, a column, a function, `not`, `-` or `(`";
const OPERATORS: [&str; 3] = ["and", "or", "not"];
const COMPARISONS: [&str; 7] = ["<", "<=", ">", ">=", "==", "=", "!="];

/// Why a text is no expression.
#[derive(Debug)]
pub struct Refusal {
    /// Byte of the text.
    at: usize,
    found: String,
    expected: String,
    hint: String,
}

impl Refusal {
    /// The same as an error of the option that the text was given to.
    pub fn error(self, option: &str, text: &str) -> Error {
        let column = text[..self.at].chars().count() + 1;
        let found = format!("{} at column {column} of `{}`", self.found, short(text));
        Error::usage(option, found, self.expected).with_hint(self.hint)
    }
}

/// The start of a long text.
pub fn short(text: &str) -> String {
    match text.char_indices().nth(SHOWN) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_string(),
    }
}

type Parsed<T> = std::result::Result<T, Refusal>;

/// Reads an expression over `columns`.
pub fn program(text: &str, columns: &[Column]) -> Parsed<(Vec<Op>, Kind)> {
    if text.len() > LONGEST {
        return Err(Refusal {
            at: 0,
            found: format!("{} bytes", text.len()),
            expected: format!("at most {LONGEST}"),
            hint: String::new(),
        });
    }
    let words = tokens(text).map_err(|at| Refusal {
        at,
        found: match text[at..].chars().next() {
            Some(c) => format!("`{c}`"),
            None => Token::End.to_string(),
        },
        expected: "numbers, names and operators".into(),
        hint: String::new(),
    })?;
    let mut parser = Parser {
        words,
        next: 0,
        depth: 0,
        columns,
        program: Vec::new(),
    };
    let (kind, _) = parser.either()?;
    match parser.peek() {
        Token::End => Ok((parser.program, kind)),
        Token::Symbol(s) if COMPARISONS.contains(&s) => {
            parser.refuse("`and` or `or`, for comparisons do not chain")
        }
        _ => parser.refuse("an operator, `and`, `or` or the end"),
    }
}

struct Parser<'a> {
    words: Vec<(Token<'a>, usize)>,
    next: usize,
    depth: usize,
    columns: &'a [Column],
    program: Vec<Op>,
}

/// What was read, and the byte where it starts.
type Operand = (Kind, usize);

impl<'a> Parser<'a> {
    fn peek(&self) -> Token<'a> {
        self.words[self.next].0
    }

    fn at(&self) -> usize {
        self.words[self.next].1
    }

    /// Moves on; the end is never passed.
    fn advance(&mut self) {
        self.next = (self.next + 1).min(self.words.len() - 1);
    }

    fn refuse<T>(&self, expected: impl Into<String>) -> Parsed<T> {
        Err(Refusal {
            at: self.at(),
            found: self.peek().to_string(),
            expected: expected.into(),
            hint: String::new(),
        })
    }

    /// Moves past one of these words, in small letters or capitals, and returns it.
    fn take(&mut self, any: &[&'static str]) -> Option<&'static str> {
        let (Token::Symbol(word) | Token::Name(word)) = self.peek() else {
            return None;
        };
        let found = any.iter().find(|w| w.eq_ignore_ascii_case(word)).copied();
        if found.is_some() {
            self.advance();
        }
        found
    }

    fn demand(&mut self, symbol: &'static str) -> Parsed<()> {
        match self.take(&[symbol]) {
            Some(_) => Ok(()),
            None => self.refuse(format!("`{symbol}`")),
        }
    }

    fn need(&self, (kind, at): Operand, wanted: Kind) -> Parsed<()> {
        let name = |k| match k {
            Kind::Number => "number",
            Kind::Condition => "condition",
        };
        if kind == wanted {
            return Ok(());
        }
        Err(Refusal {
            at,
            found: format!("the {} that starts", name(kind)),
            expected: format!("a {}", name(wanted)),
            hint: String::new(),
        })
    }

    fn binary(&mut self, name: &str) {
        self.program.extend(operator(name).map(Op::Binary));
    }

    /// Operators of one precedence from left to right.
    fn chain(
        &mut self,
        names: &[&'static str],
        kind: Kind,
        inner: fn(&mut Self) -> Parsed<Operand>,
    ) -> Parsed<Operand> {
        let first = inner(self)?;
        let mut many = false;
        while let Some(name) = self.take(names) {
            if !many {
                self.need(first, kind)?;
                many = true;
            }
            let other = inner(self)?;
            self.need(other, kind)?;
            self.binary(match name {
                "&&" => "and",
                "||" => "or",
                name => name,
            });
        }
        Ok(first)
    }

    fn either(&mut self) -> Parsed<Operand> {
        self.chain(&["or", "||"], Kind::Condition, Self::both)
    }

    fn both(&mut self) -> Parsed<Operand> {
        self.chain(&["and", "&&"], Kind::Condition, Self::opposite)
    }

    fn opposite(&mut self) -> Parsed<Operand> {
        let start = self.at();
        let mut count = 0;
        while self.take(&["not", "!"]).is_some() {
            count += 1;
        }
        let operand = self.comparison()?;
        if count == 0 {
            return Ok(operand);
        }
        self.need(operand, Kind::Condition)?;
        if count % 2 == 1 {
            self.program.push(Op::Not);
        }
        Ok((Kind::Condition, start))
    }

    fn comparison(&mut self) -> Parsed<Operand> {
        let left = self.sum()?;
        let Some(name) = self.take(&COMPARISONS) else {
            return Ok(left);
        };
        let equality = matches!(name, "==" | "=" | "!=");
        if !equality {
            self.need(left, Kind::Number)?;
        }
        let right = self.sum()?;
        if !equality {
            self.need(right, Kind::Number)?;
        }
        self.binary(name);
        Ok((Kind::Condition, left.1))
    }

    fn sum(&mut self) -> Parsed<Operand> {
        self.chain(&["+", "-"], Kind::Number, Self::product)
    }

    fn product(&mut self) -> Parsed<Operand> {
        self.chain(&["*", "/"], Kind::Number, Self::signed)
    }

    fn signed(&mut self) -> Parsed<Operand> {
        let start = self.at();
        let mut signs = 0;
        let mut negative = false;
        while let Some(sign) = self.take(&["-", "+"]) {
            signs += 1;
            negative ^= sign == "-";
        }
        let operand = self.power()?;
        if signs == 0 {
            return Ok(operand);
        }
        self.need(operand, Kind::Number)?;
        if negative {
            self.program.push(Op::Negate);
        }
        Ok((Kind::Number, start))
    }

    fn power(&mut self) -> Parsed<Operand> {
        let base = self.primary()?;
        if self.take(&["^"]).is_none() {
            return Ok(base);
        }
        self.need(base, Kind::Number)?;
        let exponent = self.nested(Self::signed)?;
        self.need(exponent, Kind::Number)?;
        self.binary("^");
        Ok(base)
    }

    /// One level deeper, which has a limit: the levels are on this program's own stack.
    fn nested<T>(&mut self, inner: impl FnOnce(&mut Self) -> Parsed<T>) -> Parsed<T> {
        if self.depth == DEEPEST {
            return self.refuse(format!(
                "at most {DEEPEST} levels of parentheses and powers"
            ));
        }
        self.depth += 1;
        let result = inner(self);
        self.depth -= 1;
        result
    }

    fn primary(&mut self) -> Parsed<Operand> {
        let start = self.at();
        match self.peek() {
            Token::Number(v) if v.is_finite() => {
                self.advance();
                self.program.push(Op::Push(v));
                Ok((Kind::Number, start))
            }
            Token::Number(_) => self.refuse("a number below 10^308"),
            Token::Name(name) => self.name(name),
            Token::Symbol("(") => {
                self.advance();
                let (kind, _) = self.nested(Self::either)?;
                self.demand(")")?;
                Ok((kind, start))
            }
            _ => self.refuse(OPERAND),
        }
    }

    fn name(&mut self, name: &str) -> Parsed<Operand> {
        let start = self.at();
        if let Some(truth) = ["false", "true"]
            .iter()
            .position(|w| w.eq_ignore_ascii_case(name))
        {
            self.advance();
            self.program.push(Op::Push(truth as f64));
            return Ok((Kind::Condition, start));
        }
        // columns come first: a table may have one of a function's name
        if let Some(column) = self.columns.iter().position(|c| c.name == name) {
            self.advance();
            self.unit(column)?;
            let flag = self.columns[column].is_condition();
            let (op, kind) = match flag {
                true => (Op::Flag(column), Kind::Condition),
                false => (Op::Column(column), Kind::Number),
            };
            self.program.push(op);
            return Ok((kind, start));
        }
        if let Some(f) = function(name) {
            self.advance();
            self.call(|p| p.argument())?;
            self.program.push(Op::Unary(f));
            return Ok((Kind::Number, start));
        }
        match name {
            "min" | "max" => {
                self.advance();
                self.call(|p| p.arguments(name))?;
                Ok((Kind::Number, start))
            }
            "missing" => {
                self.advance();
                self.call(Self::asked)?;
                self.program.push(Op::Missing);
                Ok((Kind::Condition, start))
            }
            _ if OPERATORS.iter().any(|w| w.eq_ignore_ascii_case(name)) => self.refuse(OPERAND),
            _ => Err(Refusal {
                at: start,
                found: self.peek().to_string(),
                expected: format!("a column: {}", names(self.columns)),
                hint: did_you_mean(name, self.columns),
            }),
        }
    }

    /// The unit of a column that may stand after its name, as in the head of the table.
    fn unit(&mut self, column: usize) -> Parsed<()> {
        let Token::Unit(given) = self.peek() else {
            return Ok(());
        };
        let Column { name, unit } = &self.columns[column];
        if given != unit {
            return match unit.as_str() {
                "" => self.refuse(format!("no unit after {name}")),
                unit => self.refuse(format!("[{unit}], the unit of {name}")),
            };
        }
        self.advance();
        Ok(())
    }

    fn call(&mut self, inner: impl FnOnce(&mut Self) -> Parsed<()>) -> Parsed<()> {
        self.demand("(")?;
        self.nested(inner)?;
        self.demand(")")
    }

    fn argument(&mut self) -> Parsed<()> {
        let operand = self.either()?;
        self.need(operand, Kind::Number)
    }

    /// Two arguments or more.
    fn arguments(&mut self, name: &str) -> Parsed<()> {
        self.argument()?;
        self.demand(",")?;
        loop {
            self.argument()?;
            self.binary(name);
            if self.take(&[","]).is_none() {
                return Ok(());
            }
        }
    }

    /// The argument of `missing`: a number, or a column that is a condition.
    fn asked(&mut self) -> Parsed<()> {
        let operand = self.either()?;
        match self.program.last_mut() {
            Some(op @ Op::Flag(_)) => {
                let Op::Flag(column) = *op else {
                    return Ok(());
                };
                *op = Op::Column(column);
                Ok(())
            }
            _ => self.need(operand, Kind::Number),
        }
    }
}
