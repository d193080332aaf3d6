//! How a bucket is reached: the variables and files of the AWS tools.
//!
//! Variables come first: those that begin with `AWS_` and that the client knows, keys, region and endpoint among them. What
//! they do not state comes from a profile. Without keys the client asks for a role: by a web identity, of a container, or
//! of the instance that it runs on.

use super::profile::Profile;
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey as Setting};
use object_store::{BackoffConfig, ClientConfigKey, ObjectStore, RetryConfig};
use std::io::{Error, ErrorKind, Result};
use std::sync::Arc;
use std::time::Duration;

/// The longest that an answer may take, unless `AWS_TIMEOUT` says otherwise.
const TIMEOUT: &str = "120s";

/// The client of a bucket, and what it knows that must not be told.
///
/// # Errors
/// [`ErrorKind::InvalidInput`] for settings that cannot be.
pub(super) fn client(bucket: &str) -> Result<(Arc<dyn ObjectStore>, Vec<String>)> {
    let mut builder = AmazonS3Builder::from_env().with_bucket_name(bucket);
    let has = |builder: &AmazonS3Builder, of: Setting| {
        builder
            .get_config_value(&of)
            .is_some_and(|text| !text.is_empty())
    };
    // `AWS_REGION` goes before the older name, as with other programs
    if let Ok(region) = std::env::var("AWS_REGION") {
        builder = builder.with_region(region);
    }
    let without_profile = [
        Setting::AccessKeyId,
        Setting::WebIdentityTokenFile,
        Setting::ContainerCredentialsRelativeUri,
    ];
    let keys_needed = !without_profile.into_iter().any(|of| has(&builder, of));
    let profile = Profile::read(keys_needed)?;
    let found = [
        (Setting::AccessKeyId, profile.key_id, keys_needed),
        (Setting::SecretAccessKey, profile.secret, keys_needed),
        (Setting::Token, profile.token, keys_needed),
        (
            Setting::Region,
            profile.region,
            !has(&builder, Setting::Region),
        ),
        (
            Setting::Endpoint,
            profile.endpoint,
            !has(&builder, Setting::Endpoint) && !has(&builder, Setting::S3Endpoint),
        ),
    ];
    for (setting, value, wanted) in found {
        if let (Some(value), true) = (value, wanted) {
            builder = builder.with_config(setting, value);
        }
    }
    let timeout = Setting::Client(ClientConfigKey::Timeout);
    if std::env::var_os("AWS_TIMEOUT").is_none() {
        builder = builder.with_config(timeout, TIMEOUT);
    }
    // an endpoint that is stated without TLS is meant so
    let endpoint = [Setting::S3Endpoint, Setting::Endpoint];
    let endpoint = endpoint.iter().find_map(|of| builder.get_config_value(of));
    if endpoint.is_some_and(|url| url.starts_with("http://")) {
        builder = builder.with_allow_http(true);
    }
    let secret = [
        Setting::AccessKeyId,
        Setting::SecretAccessKey,
        Setting::Token,
    ];
    let secrets = secret
        .iter()
        .filter_map(|of| builder.get_config_value(of))
        .collect();
    // requests are made again in one place, which knows of short answers, too
    let once = RetryConfig {
        backoff: BackoffConfig::default(),
        max_retries: 0,
        retry_timeout: Duration::ZERO,
    };
    let store = builder.with_retry(once).build().map_err(|e| {
        let text = format!("how the bucket is reached cannot be told: {e}");
        Error::new(ErrorKind::InvalidInput, text)
    })?;
    Ok((Arc::new(store), secrets))
}
