//! Keys, region and endpoint as the files of the AWS tools have them: `~/.aws/credentials` and `~/.aws/config`.

use std::collections::HashMap;
use std::io::{Error, ErrorKind, Result};
use std::path::PathBuf;

/// What a profile states.
#[derive(Default, PartialEq, Eq)]
pub(super) struct Profile {
    pub key_id: Option<String>,
    pub secret: Option<String>,
    pub token: Option<String>,
    pub region: Option<String>,
    pub endpoint: Option<String>,
}

/// Ways of a profile to keys that other programs know and this one does not.
const OTHER_WAYS: [&str; 5] = [
    "role_arn",
    "sso_session",
    "sso_account_id",
    "credential_process",
    "web_identity_token_file",
];

impl Profile {
    /// Reads the profile `AWS_PROFILE`, or `default`, where there are files; `keys` tells whether it has to have keys, should
    /// it have another way to them.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`] if the profile that was asked for is in no file; [`ErrorKind::Unsupported`] if its keys come
    /// from elsewhere.
    pub fn read(keys: bool) -> Result<Profile> {
        let asked = std::env::var("AWS_PROFILE")
            .ok()
            .filter(|name| !name.is_empty());
        let text = |variable: &str, file: &str| {
            let named = std::env::var_os(variable).map(PathBuf::from);
            let own = || {
                Some(
                    PathBuf::from(std::env::var_os("HOME")?)
                        .join(".aws")
                        .join(file),
                )
            };
            let path = named.or_else(own)?;
            std::fs::read_to_string(path).ok()
        };
        let credentials = text("AWS_SHARED_CREDENTIALS_FILE", "credentials").unwrap_or_default();
        let config = text("AWS_CONFIG_FILE", "config").unwrap_or_default();
        let name = asked.as_deref().unwrap_or("default");
        match Profile::of(&credentials, &config, name, keys)? {
            Some(profile) => Ok(profile),
            None if asked.is_none() => Ok(Profile::default()),
            None => {
                let text =
                    format!("AWS_PROFILE: the profile {name} is in no file of the AWS tools");
                Err(Error::new(ErrorKind::NotFound, text))
            }
        }
    }

    /// The profile of a name in the texts of both files; `None` if neither has it.
    fn of(credentials: &str, config: &str, name: &str, keys: bool) -> Result<Option<Profile>> {
        let own = section(credentials, &[name.to_owned()]);
        let more = section(config, &[name.to_owned(), format!("profile {name}")]);
        if own.is_none() && more.is_none() {
            return Ok(None);
        }
        let [own, more] = [own, more].map(Option::unwrap_or_default);
        let get = |key: &str| {
            own.get(key)
                .or_else(|| more.get(key))
                .map(|&text| text.to_owned())
        };
        let profile = Profile {
            key_id: get("aws_access_key_id"),
            secret: get("aws_secret_access_key"),
            token: get("aws_session_token"),
            region: get("region"),
            endpoint: get("endpoint_url"),
        };
        let other = OTHER_WAYS.into_iter().find(|way| get(way).is_some());
        match (other, profile.key_id.is_none() && keys) {
            (Some(way), true) => {
                let text = format!(
                    "the profile {name} has its keys by {way}, which this program does not know: \
                     `aws configure export-credentials --profile {name} --format env` makes variables of them"
                );
                Err(Error::new(ErrorKind::Unsupported, text))
            }
            _ => Ok(Some(profile)),
        }
    }
}

/// The keys and values of a section that has one of these names; `None` if there is none.
fn section<'a>(text: &'a str, names: &[String]) -> Option<HashMap<&'a str, &'a str>> {
    let mut found: Option<HashMap<&str, &str>> = None;
    let mut inside = false;
    for line in text.lines() {
        let whole = line.trim();
        if whole.is_empty() || whole.starts_with(['#', ';']) {
            continue;
        }
        if let Some(name) = whole
            .strip_prefix('[')
            .and_then(|rest| rest.split(']').next())
        {
            let words = name.split_whitespace().collect::<Vec<_>>().join(" ");
            inside = names.contains(&words);
            if inside {
                found.get_or_insert_default();
            }
        } else if let (true, Some((key, value))) = (inside, whole.split_once('='))
            // what is indented belongs to the key above
            && !line.starts_with([' ', '\t'])
        {
            found
                .get_or_insert_default()
                .insert(key.trim(), value.trim());
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const CREDENTIALS: &str = "[default]\naws_access_key_id = A\naws_secret_access_key=B\n\n[lab]\n\
                               aws_access_key_id=C\naws_secret_access_key = D==\naws_session_token = E\n";
    const CONFIG: &str = "# of the lab\n[default]\nregion = eu-central-1\ns3 =\n  endpoint_url = no\n[profile lab]\n\
                          endpoint_url = http://127.0.0.1:9000\n[profile by-role]\nrole_arn = arn\n";

    #[test]
    fn profiles_are_those_of_the_aws_tools() {
        let of = |name, keys| Profile::of(CREDENTIALS, CONFIG, name, keys);
        let texts = |p: Profile| {
            [p.key_id, p.secret, p.token, p.region, p.endpoint].map(Option::unwrap_or_default)
        };
        let default = of("default", true).unwrap().map(texts);
        assert_eq!(
            default,
            Some(["A", "B", "", "eu-central-1", ""].map(String::from))
        );
        let lab = of("lab", true).unwrap().map(texts);
        assert_eq!(
            lab,
            Some(["C", "D==", "E", "", "http://127.0.0.1:9000"].map(String::from))
        );
        assert!(of("nobody", true).unwrap().is_none());
        let refused = of("by-role", true).err().unwrap();
        assert!(refused.to_string().contains("role_arn"), "{refused}");
        assert!(of("by-role", false).unwrap().is_some());
    }
}
