// What a program and its reader process say to each other.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/triangle_mesh.h"
#include "builder/sources/array_union.h"
#include "builder/sources/process/channel.h"
#include "builder/sources/process/opened_files.h"
#include "builder/sources/source.h"

namespace splatvol {

/// A request has this, the number of a source (of no meaning for `surface` and `list`), and what each kind adds. The
/// answer begins with an optional Error.
enum class ReaderRequest : std::uint32_t {
  open,     // inputs, SourceOptions. Answer: SourceState. The number is new
  next,     // whether values are lent, and whole cells told. Answer: SourceState, whether there is a piece, the piece
  bounds,   // Answer: optional Box
  parts,    // Answer: sizes of the parts
  select,   // numbers of parts. Answer: nothing
  close,    // No answer
  surface,  // path. Answer: TriangleMesh
  list,     // inputs, SourceOptions. Answer: whether arrays can be listed, and these
};

/// What a source tells besides its pieces. Its functions may return something else after each piece.
struct SourceState {
  std::vector<std::string> attributes, units, conversions;
  std::vector<int> components;
  std::uint64_t pieces = 0;
  Source::PieceNumber number;  // of the last piece
  std::optional<std::uint64_t> points;
  std::optional<TimeStep> step;
  std::optional<double> time;  // stated
  std::uint64_t left_out_cells = 0;
  VertexCopies copies = VertexCopies::same_values;
  bool averages_by_piece = false;
  bool may_have_cells = true;
  bool brings_material = false;
  bool single_precision = false;
  OpenedFiles files;  // since the last state
};

[[nodiscard]] SourceState state_of(const Source& source);

/// Messages are cut at 4 KiB, and so are the conversions of a state.
[[nodiscard]] Status put(Channel& channel, const Error& error);

/// The message is one line without control characters. Fails if it is longer, or of no kind.
[[nodiscard]] Status get(Channel& channel, Error& error);
[[nodiscard]] Status put(Channel& channel, const SourceOptions& options);
[[nodiscard]] Status get(Channel& channel, SourceOptions& options);
[[nodiscard]] Status put(Channel& channel, const SourceState& state);
[[nodiscard]] Status get(Channel& channel, SourceState& state);

[[nodiscard]] Status put(Channel& channel, const std::optional<std::vector<ArrayShape>>& arrays);
[[nodiscard]] Status get(Channel& channel, std::optional<std::vector<ArrayShape>>& arrays);

/// Frees each array once it is sent, so that both processes together hold little more than one piece.
[[nodiscard]] Status put(Channel& channel, std::unique_ptr<Piece> piece, std::size_t attributes);

/// Lent values are held. Fails if the arrays do not fit each other, or if an index is out of range.
[[nodiscard]] Status get(Channel& channel, Piece& piece, std::size_t attributes);

[[nodiscard]] Status put(Channel& channel, const TriangleMesh& mesh);

/// Fails if an index or a coordinate is out of range.
[[nodiscard]] Status get(Channel& channel, TriangleMesh& mesh);

}  // namespace splatvol
