// Names of attributes, columns and arrays: the checks and the messages that several layers share.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"

namespace splatvol {

/// Returns the failure for a name that `file` lacks, with invalid_argument. The message lists the available names:
/// `a.vtu: no attribute "x"; there are: p, q`.
[[nodiscard]] tl::unexpected<Error> fail_no_attribute(const std::string& file, const std::string& name,
                                                      std::span<const std::string> available);

/// Whether a name is as a pattern says, in which `*` stands for any characters, or none.
[[nodiscard]] bool matches(std::string_view name, std::string_view pattern);

/// Whether a patch is one of those that svbuild makes of all faces that no patch of the input has: "outer", "outer 1",
/// "outer rest", "side x-" and the like.
[[nodiscard]] bool is_patch_of_rest(std::string_view name);

/// Returns the indices of the names that match a pattern. If no patch is called "outer", patches of the rest match as
/// "outer", too: that is what files called all of them. Fails with invalid_argument if there is none; the message
/// begins with `file`, and lists the names.
[[nodiscard]] Result<std::vector<std::size_t>> find_patches(const std::string& file, const std::string& pattern,
                                                            std::span<const std::string> names);

/// Returns the name that becomes `name` by the fewest changes of a letter. Requires that there is one.
[[nodiscard]] std::string_view nearest_name(std::string_view name, std::span<const std::string_view> known);

/// Returns a text with its letters A to Z in lower case.
[[nodiscard]] std::string in_lower_case(std::string text);

/// Returns `name` if it is free, else the first of `name (splat)`, `name (splat 2)`, `name (splat 3)`, ... that is
/// free.
[[nodiscard]] std::string free_name(const std::string& name, const std::function<bool(const std::string&)>& is_taken);

/// Returns a name that appears at least twice, or nothing. If several do, returns the lowest of them, byte by byte.
[[nodiscard]] std::optional<std::string> find_duplicate(std::vector<std::string> names);

}  // namespace splatvol
