//! The words of an expression.

use winnow::LocatingSlice;
use winnow::Parser;
use winnow::ascii::{float, multispace0};
use winnow::combinator::{alt, delimited, peek, preceded, repeat};
use winnow::error::ContextError;
use winnow::stream::Location;
use winnow::token::{one_of, take_while};

/// A word of an expression.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Token<'a> {
    /// A number without a sign; infinite if it is too large.
    Number(f64),
    /// A name or a word such as `and`.
    Name(&'a str),
    /// An operator or a mark of punctuation.
    Symbol(&'static str),
    /// What stands in brackets after a name in the head of a table: `mm^3`.
    Unit(&'a str),
    /// The end of the text.
    End,
}

impl std::fmt::Display for Token<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Token::Number(v) => write!(f, "{v}"),
            Token::Name(name) => write!(f, "`{name}`"),
            Token::Symbol(symbol) => write!(f, "`{symbol}`"),
            Token::Unit(unit) => write!(f, "`[{unit}]`"),
            Token::End => f.write_str("the end"),
        }
    }
}

type Input<'a> = LocatingSlice<&'a str>;

/// Splits a text into its words, each with the byte at which it starts; the last is
/// [`Token::End`].
///
/// # Errors
/// The byte of the first character that begins no word.
pub fn tokens(text: &str) -> Result<Vec<(Token<'_>, usize)>, usize> {
    let mut input = LocatingSlice::new(text);
    let word = delimited(multispace0, token.with_span(), multispace0)
        .map(|(token, span): (Token, std::ops::Range<usize>)| (token, span.start));
    let words: Result<Vec<_>, ContextError> = repeat(0.., word).parse_next(&mut input);
    let at = input.current_token_start();
    match words {
        Ok(mut words) if text[at..].trim().is_empty() => {
            words.push((Token::End, text.len()));
            Ok(words)
        }
        _ => Err(at + (text[at..].len() - text[at..].trim_start().len())),
    }
}

fn token<'a>(input: &mut Input<'a>) -> winnow::Result<Token<'a>> {
    alt((name, number, unit, symbol)).parse_next(input)
}

fn name<'a>(input: &mut Input<'a>) -> winnow::Result<Token<'a>> {
    let first = one_of(|c: char| c.is_ascii_alphabetic() || c == '_');
    let rest = take_while(0.., |c: char| c.is_ascii_alphanumeric() || c == '_');
    (first, rest).take().map(Token::Name).parse_next(input)
}

fn number<'a>(input: &mut Input<'a>) -> winnow::Result<Token<'a>> {
    // the parser of numbers would also take signs and words such as `inf`
    let start = one_of(|c: char| c.is_ascii_digit() || c == '.');
    preceded(peek(start), float)
        .map(Token::Number)
        .parse_next(input)
}

fn unit<'a>(input: &mut Input<'a>) -> winnow::Result<Token<'a>> {
    let inside = take_while(1.., |c: char| !"[]".contains(c));
    delimited('[', inside, ']')
        .map(Token::Unit)
        .parse_next(input)
}

fn symbol<'a>(input: &mut Input<'a>) -> winnow::Result<Token<'a>> {
    let two = alt((
        "<=".value("<="),
        ">=".value(">="),
        "==".value("=="),
        "!=".value("!="),
        "&&".value("&&"),
        "||".value("||"),
    ));
    let one = alt((
        alt((
            "<".value("<"),
            ">".value(">"),
            "=".value("="),
            "!".value("!"),
        )),
        alt((
            "+".value("+"),
            "-".value("-"),
            "*".value("*"),
            "/".value("/"),
        )),
        alt((
            "^".value("^"),
            "(".value("("),
            ")".value(")"),
            ",".value(","),
        )),
    ));
    alt((two, one)).map(Token::Symbol).parse_next(input)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_have_their_places() {
        use Token::{End, Name, Number, Symbol};
        assert_eq!(
            tokens(" a1>=.5e1&&!_b(2.)").unwrap(),
            [
                (Name("a1"), 1),
                (Symbol(">="), 3),
                (Number(5.0), 5),
                (Symbol("&&"), 9),
                (Symbol("!"), 11),
                (Name("_b"), 12),
                (Symbol("("), 14),
                (Number(2.0), 15),
                (Symbol(")"), 17),
                (End, 18)
            ]
        );
        let unit = tokens("v [mm^3]>1").unwrap();
        assert_eq!(unit[..2], [(Name("v"), 0), (Token::Unit("mm^3"), 2)]);
        assert_eq!(tokens("inf").unwrap()[0].0, Name("inf"));
        assert_eq!(tokens(" ").unwrap(), [(End, 1)]);
        for (bad, at) in [
            ("a ? b", 2),
            ("a & b", 2),
            ("v > 3 µ", 6),
            (".", 0),
            ("\"a\"", 0),
            ("v []", 2),
            ("v [mm", 2),
        ] {
            assert_eq!(tokens(bad), Err(at), "{bad}");
        }
    }
}
