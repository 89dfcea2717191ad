// Which files a program may replace.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "base/error.h"

namespace splatvol {

/// Which of the files that may be inputs (.vtu, .vtp, .stl, .glb, .vdb, .npy, .csv) a program may replace: those with
/// the mark of an export, or any. Pictures, .svol files, indices and JSON have no mark, and are always replaced.
enum class Replace { exports, any };

/// The mark of an exported .vtu or .vtp file: a comment before its first element. VTK drops comments, so that a file
/// that a user has edited and saved has no mark.
inline constexpr std::string_view vtk_export_mark = "<!-- splatvol export -->";

/// The mark of an exported .stl file: the beginning of its header.
inline constexpr std::string_view stl_export_mark = "splatvol export";
inline constexpr std::size_t stl_header_bytes = 80;

/// The mark of an exported .glb file, in its JSON.
inline constexpr std::string_view glb_export_mark = "\"generator\":\"splatvol export\"";

/// Where a .vdb file has its UUID, a text of 36 characters: behind magic, versions and a flag.
inline constexpr std::size_t vdb_uuid_offset = 8 + 4 + 4 + 4 + 1;
inline constexpr std::size_t vdb_uuid_bytes = 36;

/// The mark of an exported .vdb file that has this UUID: metadata of the file, within its first 4096 bytes. OpenVDB
/// gives a file that it saves another UUID, so that the mark no longer holds there even if the metadata were kept.
[[nodiscard]] std::string vdb_export_mark(std::string_view uuid);

/// Fails if `path` names a file that is not of the kind that its extension stands for: .svol, .svols, .png, .exr,
/// .json, .npy, .vdb, .vtu, .vtp or .glb, in either case. Such a file was made by another program, and writing would
/// destroy it. Nothing tells what a .stl or .csv file is. Fails also if the file may be an input of svbuild and has no
/// mark, unless `replace` is Replace::any; the message names the option --force. Reads at most 4096 bytes. Succeeds if
/// there is no file, if it is empty, or if its extension is another.
[[nodiscard]] Status check_replaceable(const std::string& path, Replace replace = Replace::exports);

/// Whether `path` ends in `extension`, such as ".svol", in either case.
[[nodiscard]] bool has_extension(const std::string& path, const std::string& extension);

}  // namespace splatvol
