#include "builder/sources/openfoam/foam_mesh.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <utility>

#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr std::uint32_t no_label = std::numeric_limits<std::uint32_t>::max();

std::uint64_t read_count(FoamReader& reader, const FoamToken& value) {
  const auto count = number_of<std::uint64_t>(value.text);
  if (!count) reader.fail("a number must stand there, and not \"{}\"", value.text.substr(0, 40));
  return *count;
}

FoamPatch read_patch(FoamReader& reader) {
  FoamPatch patch{reader.next().text, {}};
  reader.expect('{');
  bool has_first = false, has_count = false;
  while (!reader.peek().is('}')) {
    const FoamToken key = reader.next();
    if (key.kind == FoamToken::Kind::end) reader.expect('}');  // throws
    if (reader.peek().is('{')) {
      reader.next();
      reader.skip_block();
      continue;
    }
    const FoamToken value = reader.peek();
    if (key.is_word("type")) patch.type = value.text;
    if (key.is_word("startFace")) patch.first_face = read_count(reader, value), has_first = true;
    if (key.is_word("nFaces")) patch.face_count = read_count(reader, value), has_count = true;
    if (key.is_word("neighbProcNo")) patch.neighbour_processor = read_count(reader, value);
    reader.skip_entry();
  }
  reader.expect('}');
  if (!has_first || !has_count) reader.fail("the patch \"{}\" lacks nFaces or startFace", patch.name);
  return patch;
}

std::vector<dvec3> read_points(const FoamPlace& place) {
  FoamReader reader(place);
  const std::vector<double> numbers = read_numbers(reader, 3);
  std::vector<dvec3> points(numbers.size() / 3);
  if (points.size() > no_label) reader.fail("more than 2^32 - 1 points");
  for (std::size_t i = 0; i < points.size(); ++i) points[i] = {numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]};
  return points;
}

LabelLists read_faces(const FoamPlace& place, std::size_t point_count) {
  FoamReader reader(place);
  LabelLists faces = read_label_lists(reader);
  const auto beyond = std::ranges::find_if(faces.values, [&](std::uint32_t point) { return point >= point_count; });
  if (beyond != faces.values.end())
    throw ReaderError("{}: a face names point {} of {}", place.name, *beyond, point_count);
  for (std::size_t face = 0; face < faces.size(); ++face)
    if (faces[face].size() < 3) throw ReaderError("{}: face {} has fewer than 3 points", place.name, face);
  return faces;
}

void read_cells(const FindMeshFile& find, FoamMesh& mesh) {
  const std::size_t count = mesh.faces.size();
  FoamReader owner(find("owner")), neighbour(find("neighbour"));
  mesh.owner = read_labels(owner, count);
  mesh.neighbour = read_labels(neighbour, count);
  if (mesh.owner.size() != count)
    throw ReaderError("{}: it has {} faces, and the mesh {}", owner.stream().name(), mesh.owner.size(), count);
  // In old files the faces of the boundary have the neighbour -1.
  while (!mesh.neighbour.empty() && mesh.neighbour.back() == no_label) mesh.neighbour.pop_back();
  std::uint32_t last = 0;
  for (const auto& [cells, reader] : {std::pair(&mesh.owner, &owner), std::pair(&mesh.neighbour, &neighbour)})
    for (const std::uint32_t cell : *cells) {
      // Each face is of two cells at most.
      if (cell >= 2 * count) throw ReaderError("{}: a face is of cell {}", reader->stream().name(), cell);
      last = std::max(last, cell);
    }
  mesh.cell_count = count == 0 ? 0 : last + 1;
}

}  // namespace

std::vector<FoamPatch> read_foam_patches(const FoamPlace& boundary) {
  FoamReader reader(boundary);
  std::optional<std::uint64_t> count;
  if (!reader.peek().is('(')) count = read_count(reader, reader.next());
  std::vector<FoamPatch> patches;
  if (count == 0 && !reader.peek().is('(')) return patches;
  reader.expect('(');
  while (!reader.peek().is(')')) patches.push_back(read_patch(reader));
  reader.expect(')');
  if (count && *count != patches.size())
    throw ReaderError("{}: it has {} patches, and not {}", boundary.name, patches.size(), *count);
  return patches;
}

FoamMesh read_foam_faces(const FindMeshFile& find) {
  FoamMesh mesh;
  mesh.points = read_points(find("points"));
  mesh.faces = read_faces(find("faces"), mesh.points.size());
  return mesh;
}

FoamMesh read_foam_mesh(const FindMeshFile& find) {
  FoamMesh mesh = read_foam_faces(find);
  read_cells(find, mesh);
  return mesh;
}

void check_foam_patches(const FoamMesh& mesh, const std::vector<FoamPatch>& patches, const std::string& name) {
  for (const FoamPatch& patch : patches)
    if (patch.face_count > 0 && (patch.first_face < mesh.neighbour.size() || patch.first_face > mesh.faces.size() ||
                                 patch.face_count > mesh.faces.size() - patch.first_face))
      throw ReaderError("{}: the patch \"{}\" has the faces {} to {}, and the boundary those from {} to {}", name,
                        patch.name, patch.first_face, patch.first_face + patch.face_count - 1, mesh.neighbour.size(),
                        mesh.faces.size() - 1);
}

LabelLists faces_of_cells(const FoamMesh& mesh) {
  LabelLists cells;
  cells.starts.assign(std::size_t{mesh.cell_count} + 1, 0);
  for (const auto* side : {&mesh.owner, &mesh.neighbour})
    for (const std::uint32_t cell : *side) ++cells.starts[std::size_t{cell} + 1];
  for (std::uint32_t cell = 0; cell < mesh.cell_count; ++cell)
    if (const std::uint32_t faces = cells.starts[std::size_t{cell} + 1]; faces < 4)
      throw ReaderError("the mesh is damaged: cell {} has {} faces", cell, faces);
  std::partial_sum(cells.starts.begin(), cells.starts.end(), cells.starts.begin());
  cells.values.resize(mesh.owner.size() + mesh.neighbour.size());
  std::vector<std::uint32_t> next(cells.starts.begin(), cells.starts.end() - 1);
  for (std::size_t face = 0; face < mesh.owner.size(); ++face) {
    cells.values[next[mesh.owner[face]]++] = static_cast<std::uint32_t>(face);
    if (face < mesh.neighbour.size()) cells.values[next[mesh.neighbour[face]]++] = static_cast<std::uint32_t>(face);
  }
  return cells;
}

}  // namespace splatvol
