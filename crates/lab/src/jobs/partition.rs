//! Shares of a list of jobs.

/// One of several shares of a list: `hash:3/16` is the third of sixteen. A job's key alone decides
/// its share, so a list that grows moves no job.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Partition {
    /// From 1.
    share: u64,
    /// At least 1.
    shares: u64,
}

impl Partition {
    /// Reads `hash:M/N`.
    ///
    /// # Errors
    /// In words, if the text is something else.
    pub fn parse(text: &str) -> Result<Self, String> {
        let wrong = || "expected hash:M/N with M from 1 to N, such as hash:3/16".to_owned();
        let numbers = text.trim().strip_prefix("hash:").and_then(|numbers| {
            let (share, shares) = numbers.split_once('/')?;
            Some((share.parse().ok()?, shares.parse().ok()?))
        });
        match numbers.ok_or_else(wrong)? {
            (share, shares) if (1..=shares).contains(&share) => Ok(Self { share, shares }),
            _ => Err(wrong()),
        }
    }

    /// Whether the job with this key belongs to the share.
    pub fn contains(&self, key: &str) -> bool {
        let digits = key.get(..16).unwrap_or(key);
        let number = u64::from_str_radix(digits, 16).unwrap_or_default();
        number % self.shares == self.share - 1
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::jobs::key;

    #[test]
    fn each_key_is_in_one_share() {
        let shares: Vec<Partition> = (1..=7)
            .map(|m| Partition::parse(&format!("hash:{m}/7")).unwrap())
            .collect();
        let mut sizes = [0; 7];
        for i in 0..700 {
            let key = key([i.to_string().as_str()]);
            let holders: Vec<usize> = (0..7).filter(|s| shares[*s].contains(&key)).collect();
            assert_eq!(holders.len(), 1);
            sizes[holders[0]] += 1;
        }
        assert!(sizes.iter().all(|n| *n > 50), "{sizes:?}");
        for wrong in ["3/16", "hash:0/4", "hash:5/4", "hash:1/0", "count:1/2"] {
            Partition::parse(wrong).unwrap_err();
        }
    }
}
