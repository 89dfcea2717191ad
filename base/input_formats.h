// The formats of inputs: one table for names of files, messages, help and docs/formats.md.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace splatvol {

/// In the order of the table.
enum class InputFormat : std::uint8_t {
  vtk_xml,
  vtk_parallel,
  vtk_legacy,
  vtk_blocks,
  vtk_series,
  vtkhdf,
  plot3d,
  exodus,
  cgns,
  ensight,
  openfoam,
  gmsh,
  su2,
  openvdb,
  numpy,
  table
};
inline constexpr std::size_t input_format_count = 16;

struct FormatRow {
  InputFormat format;
  std::string_view name;        // in messages and help
  std::string_view extensions;  // of its files, in lower case, with a blank between; empty: any
  std::string_view help;        // the files, in the help of programs
  // The other cells of its row in docs/formats.md, in their order.
  std::string_view files, held, steps, cells, left_out;
};

/// [format]
[[nodiscard]] const std::array<FormatRow, input_format_count>& input_formats();

[[nodiscard]] std::string_view name_of(InputFormat format);

/// The formats as the help of programs lists them.
[[nodiscard]] std::string input_formats_for_help();

/// Finds a format by the name of a file, in either case. An Exodus file that holds a part of a mesh has a name such as
/// "mesh.e.4.0", one of a run that went on "mesh.e-s002"; a case of OpenFOAM may be its system/controlDict.
[[nodiscard]] std::optional<InputFormat> format_of_name(std::string_view path);

/// Whether a name is that of a series of files as ParaView writes it, in JSON.
[[nodiscard]] bool is_file_series(std::string_view path);

/// Whether the file has data in a format that is not read, by its name.
[[nodiscard]] bool is_foreign(std::string_view path);

/// Returns how a file of a format that is not read becomes one that is.
[[nodiscard]] std::string way_out(std::string_view path);

/// Whether a folder is a case of OpenFOAM.
[[nodiscard]] bool is_openfoam_case(const std::string& folder);

/// Whether a file in a folder of inputs is one of them, by its name. A .txt may be any text.
[[nodiscard]] bool is_input_in_folder(const std::string& name);

/// Whether svbuild is to be asked to turn a path into a .svol file: a mesh or points by the file's name, a case of
/// OpenFOAM, or a folder that holds such files. Formats that are not read count, too: svbuild says what to do. Surfaces
/// do not.
[[nodiscard]] bool is_convertible(const std::string& path);

/// Tells what to do with a mesh at an address.
inline constexpr const char* no_far_mesh = "meshes are read from disks: run svbuild there, or download it first";

/// Whether a file holds a surface to draw, not a volume, by its name: .stl, .obj, .ply, .glb or .gltf.
[[nodiscard]] bool is_surface_file(std::string_view path);

}  // namespace splatvol
