//! Which views are read of those that a layout lists.

use crate::names::Names;
use crate::options::ReadOptions;

/// The views that [`ReadOptions::only`] and [`ReadOptions::except`] leave.
pub(crate) struct Wanted<'a> {
    options: &'a ReadOptions,
    only: Option<Names>,
    except: Names,
}

impl<'a> Wanted<'a> {
    pub(crate) fn of(options: &'a ReadOptions) -> Self {
        let names = |names: &[String]| Names::of(names.iter().map(String::as_str));
        let only = options.only.as_deref().map(names);
        Self { options, only, except: names(&options.except) }
    }

    /// Whether a view, or an image by its file, is read.
    pub(crate) fn has(&self, view: &str) -> bool {
        self.only.as_ref().is_none_or(|only| only.has(view)) && !self.except.has(view)
    }

    /// The first name that means none of the views that were kept, or none of those that were left out, and what it is for.
    pub(crate) fn missed(&self, kept: &[&str], left_out: &[&str]) -> Option<(&str, &'static str)> {
        let absent = |names: &'a [String], views: &[&str]| -> Option<&'a str> {
            let read = Names::of(views.iter().copied());
            names.iter().find(|name| !read.has(name)).map(String::as_str)
        };
        // A view that is named twice, to be read and to be left out, is left out.
        let all = [kept, left_out].concat();
        let only = self.options.only.as_deref().and_then(|names| absent(names, &all));
        let except =
            || absent(&self.options.except, left_out).map(|name| (name, "those that are left out"));
        only.map(|name| (name, "those that are named")).or_else(except)
    }
}
