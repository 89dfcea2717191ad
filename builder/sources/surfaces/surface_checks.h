// Checks of surface files before VTK's readers see them: they draw what there is of a file that is cut off.
#pragma once

#include <string>

#include "base/error.h"

namespace splatvol {

/// Fails unless an .stl file has all triangles that it states, or ends its text. Fails also at a word of a text that is
/// no number. Safe on untrusted files.
[[nodiscard]] Status check_stl(const std::string& path);

/// How the last line of a file ends.
enum class LastLine {
  ended,
  open,         // without the end of a line
  open_number,  // without it, behind a number, which may be cut off
};

/// Fails unless a .ply file, text or binary, has all elements that its header states. Fails also at a word of a text
/// that is no number, and at what VTK's reader takes for something else: an order of its own, long lines, faces of many
/// corners. VTK's reader loses a last line that is open. Safe on untrusted files.
[[nodiscard]] Result<LastLine> check_ply(const std::string& path);

/// Fails at a line of an .obj file that has fewer numbers than its kind needs, or words instead of them, and at a face
/// with a corner that is not there. How many lines must follow an .obj file does not tell. Safe on untrusted files.
[[nodiscard]] Result<LastLine> check_obj(const std::string& path);

}  // namespace splatvol
