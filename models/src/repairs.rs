//! What mends a published configuration, one change at a time.

/// A change that the head of a preset lists.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Repair<'a> {
    /// Options and their values, as `--set` takes them.
    pub settings: Vec<(&'a str, &'a str)>,
    /// What it mends.
    pub meaning: &'a str,
}

/// The repairs that a preset's head lists, each alone over the published form: lines of
/// `# repair: key = value; other-key = value # what it mends`.
///
/// ```
/// let head = "# As published.\n# repair: overshoot = false # the last step ends at 1\nseed = 0 # ours\n";
/// let found = models::repairs(head);
/// assert_eq!(found[0].settings, [("overshoot", "false")]);
/// assert_eq!((found.len(), found[0].meaning), (1, "the last step ends at 1"));
/// ```
pub fn repairs(preset: &str) -> Vec<Repair<'_>> {
    let listed = preset.lines().filter_map(|line| line.strip_prefix("# repair: "));
    let one = |line| {
        let (settings, meaning): (&str, &str) = str::split_once(line, " # ").unwrap_or((line, ""));
        let settings = settings.split("; ").filter_map(|setting| setting.split_once(" = "));
        let settings = settings.map(|(key, value)| (key.trim(), value.trim())).collect();
        Repair { settings, meaning: meaning.trim() }
    };
    listed.map(one).collect()
}
