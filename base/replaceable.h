// Which files a program may replace.
#pragma once

#include <string>

#include "base/error.h"

namespace splatvol {

/// Fails if `path` names a file that is not of the kind that its extension stands for: .svol, .svols, .png, .exr,
/// .json, .npy, .vdb or .vtu, in either case. Such a file was made by another program, and writing would destroy it.
/// Succeeds if there is no file, if it is empty, or if its extension is another.
[[nodiscard]] Status check_replaceable(const std::string& path);

/// Whether `path` ends in `extension`, such as ".svol", in either case.
[[nodiscard]] bool has_extension(const std::string& path, const std::string& extension);

}  // namespace splatvol
