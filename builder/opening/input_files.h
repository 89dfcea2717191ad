// Which files an input consists of, and which formats they have.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "builder/sources/vtk/data_sets.h"

namespace splatvol {

/// The format of a file, by its first bytes and its name.
struct FileHeader {
  enum class Format { vtk_xml, vtk_legacy, multi_block, npy, csv, vdb, other };
  Format format = Format::other;
  VtkFile::Kind kind = VtkFile::Kind::unstructured;  // of a multi-block file
  std::string type = {};                             // of an XML file: "UnstructuredGrid", ...
  int major = 0;
  int minor = 0;
};

[[nodiscard]] Result<FileHeader> read_header(const std::string& path);

/// Whether a name is that of a .csv or .tsv file, in either case.
[[nodiscard]] bool is_csv(std::string_view path);

/// Whether a name is that of one of VTK's own files, in either case.
[[nodiscard]] bool has_vtk_extension(std::string_view path);

/// Replaces folders by the files in them whose names tell that they can be read. An OpenFOAM case is a folder, but one
/// input.
[[nodiscard]] Result<std::vector<std::string>> expand_folders(const std::vector<std::string>& inputs);

/// Returns the files in folders that hold data, but that expand_folders() leaves out for their names.
[[nodiscard]] std::vector<std::string> files_left_out(const std::vector<std::string>& inputs);

/// Returns the axis that points upwards by the convention of the inputs' format: 2 (z) for OpenFOAM; -1: no convention.
[[nodiscard]] int usual_up(const std::vector<std::string>& inputs);

}  // namespace splatvol
