// How much there is to read.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace splatvol {

/// Returns the bytes of the files that a reader of these inputs may read, each file once; 0 where it cannot tell:
/// - a folder: all files in it and in its folders. A file of OpenFOAM stands for the folder of its case;
/// - a file that lists others in a text (.pvd, .series, .pvtu, .pvti, .vtm, .vtpd, .vtpc, .case, .encas, .gltf): it and
///   these, at any depth;
/// - a part of an Exodus mesh: all parts;
/// - each other file: the file.
/// Looks for 2^20 files at most. Safe on untrusted files.
[[nodiscard]] std::uint64_t input_bytes(const std::vector<std::string>& inputs);

/// Returns these files.
[[nodiscard]] std::vector<std::string> input_files(const std::vector<std::string>& inputs);

}  // namespace splatvol
