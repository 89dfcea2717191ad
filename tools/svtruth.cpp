// svtruth: the exact picture of a mesh.
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <numeric>
#include <tuple>

#include "base/file.h"
#include "base/json.h"
#include "base/memory_limit.h"
#include "builder/boundary/boundary_faces.h"
#include "builder/boundary/simplify.h"
#include "builder/opening/open_own.h"
#include "pictures/image.h"
#include "renderer/reference/reference.h"
#include "renderer/reference/slice.h"
#include "renderer/surfaces/draw_surfaces.h"
#include "scene/scene.h"
#include "tools/cells_option.h"
#include "tools/reading.h"
#include "tools/scene_options.h"
#include "tools/svtruth_surfaces.h"
#include "tools/tool.h"
#include "tools/version.h"

namespace splatvol {
namespace {

struct Options {
  std::vector<std::string> meshes;
  std::string scene;
  std::string output;
  std::string size;
  std::string cells = "averaged";
  std::vector<double> missing;
  bool no_displacements = false;
  unsigned threads = default_threads();
  int repeat = 1;
  ReadingOptions reading;
  bool json = false;
};

/// The whole input.
struct Mesh {
  std::vector<dvec3> points;
  std::vector<std::string> attributes;      // of the scene
  std::vector<std::vector<double>> values;  // [attribute]: of the points
  std::vector<std::array<std::uint32_t, 4>> tetrahedra;
  bool constant = false;                     // values: of the tetrahedra
  std::vector<std::uint32_t> vertices = {};  // as TetMesh::vertices

  // None for an empty name.
  [[nodiscard]] std::span<const double> values_of(const std::string& attribute) const {
    const auto found = std::ranges::find(attributes, attribute);
    if (found == attributes.end()) return {};
    return values[static_cast<std::size_t>(found - attributes.begin())];
  }
  [[nodiscard]] TetMesh view(const Scene& scene) const {
    return {points,
            values_of(scene.attribute),
            tetrahedra,
            constant,
            values_of(opacity_attribute_of(scene)),
            values_of(contours_of(scene).attribute),
            vertices};
  }
};

/// The attributes that a scene needs, that of the volume first. None is there twice.
std::vector<std::string> attributes_of(const Scene& scene) {
  std::vector<std::string> attributes = {scene.attribute};
  const auto add = [&](const std::string& attribute) {
    if (!attribute.empty() && std::ranges::find(attributes, attribute) == attributes.end())
      attributes.push_back(attribute);
  };
  add(opacity_attribute_of(scene));
  add(contours_of(scene).attribute);
  for (const SceneSurface& surface : scene.surfaces)
    if (surface.shown && surface.color_by) add(surface.color_by->attribute);
  return attributes;
}

void append_values(const Piece& piece, std::size_t attribute, std::vector<double>& values) {
  const std::vector<double>& all = piece.values[attribute];
  if (!piece.cells) {
    values.insert(values.end(), all.begin(), all.end());
    return;
  }
  for (const auto point : piece.cells->points)
    if (point != PointCells::no_point) values.push_back(all[point]);
}

Status append_piece(const Piece& piece, Mesh& mesh) {
  const std::vector<dvec3>& points = piece.cells ? piece.cells->corners : piece.points;
  const auto& tetrahedra = piece.cells ? piece.cells->tetrahedra : piece.tetrahedra;
  if (points.size() > std::numeric_limits<std::uint32_t>::max() - mesh.points.size())
    return fail(ErrorCode::unsupported, "more than 4294967295 points");
  const auto offset = static_cast<std::uint32_t>(mesh.points.size());
  mesh.points.insert(mesh.points.end(), points.begin(), points.end());
  for (std::size_t i = 0; i < mesh.values.size(); ++i) append_values(piece, i, mesh.values[i]);
  mesh.tetrahedra.reserve(mesh.tetrahedra.size() + tetrahedra.size());
  for (std::size_t t = 0; t < tetrahedra.size(); ++t) {
    if (piece.cells && piece.cells->points[t] == PointCells::no_point) continue;
    auto tetrahedron = tetrahedra[t];
    for (std::uint32_t& point : tetrahedron) point += offset;
    mesh.tetrahedra.push_back(tetrahedron);
  }
  return {};
}

/// Finds copies of vertices, of pieces or at a seam: of one position and value, as svbuild joins them.
std::vector<std::uint32_t> find_copies(const Mesh& mesh) {
  const std::vector<double>& values = mesh.values.front();
  std::vector<std::uint32_t> order(mesh.points.size()), vertices(mesh.points.size());
  std::iota(order.begin(), order.end(), 0U);
  const auto key = [&](std::uint32_t i) {
    const dvec3& point = mesh.points[i];
    return std::tuple(point.x, point.y, point.z, values[i]);
  };
  // What is missing has no order.
  std::erase_if(order, [&](std::uint32_t i) {
    const auto [x, y, z, value] = key(i);
    vertices[i] = i;
    return std::isnan(x + y + z + value);
  });
  std::ranges::sort(order, {}, key);
  for (std::size_t i = 1; i < order.size(); ++i)
    if (key(order[i]) == key(order[i - 1])) vertices[order[i]] = vertices[order[i - 1]];
  return vertices;
}

/// Reads the attributes of a scene. `boundary`: gets the faces of all pieces; may be null.
Result<Mesh> read_mesh(const std::vector<std::string>& paths, const Scene& scene, SourceOptions source_options,
                       const ReaderProcessOptions& reader_options, BoundaryFaces* boundary) {
  source_options.selection = attributes_of(scene);
  SPLATVOL_TRY(check_no_address(paths));
  warn_of_left_out(paths);
  ReaderProcess reader(reader_options);
  SPLATVOL_TRY_ASSIGN(source, open_safely(reader, paths, source_options));
  ProgressBar bar("read");
  Mesh mesh{.points = {}, .attributes = attributes_of(scene), .values = {}, .tetrahedra = {}};
  mesh.values.resize(mesh.attributes.size());
  for (std::size_t read = 1;; ++read) {
    SPLATVOL_TRY_ASSIGN(piece, source->next());
    if (!piece) break;
    mesh.constant = piece->cells.has_value();
    if (boundary) SPLATVOL_TRY(boundary->add(*piece));
    if (auto status = append_piece(*piece, mesh); !status) return fail_in(paths.front(), status.error());
    bar.update(static_cast<double>(read) / static_cast<double>(source->piece_count()));
  }
  if (mesh.tetrahedra.empty()) return fail(ErrorCode::invalid_data, "{}: no cells with a volume", paths.front());
  if (!contours_of(scene).surfaces.empty() && !mesh.constant) mesh.vertices = find_copies(mesh);
  return mesh;
}

// The exact values on the slices of the view.
Result<std::vector<SlicePicture>> draw_slices(const TetMesh& mesh, const View& view, const TransferFunction& function) {
  std::vector<SlicePicture> pictures;
  for (const Slice& slice : view.slices) {
    std::vector<double> depths = slice_depths(view, slice.plane);
    SPLATVOL_TRY_ASSIGN(values, exact_slice(mesh, view, slice.plane, depths));
    pictures.push_back(color_slice(view, slice, std::move(depths), values, function));
  }
  return pictures;
}

/// Gives surfaces the values that colour them.
void add_values(const Mesh& mesh, std::span<Surface> surfaces) {
  for (Surface& surface : surfaces) {
    if (!surface.is_visible() || !surface.style.color_by) continue;
    const std::string& attribute = surface.style.color_by->attribute;
    std::vector<dvec3> middles;
    for (std::size_t i = 0; mesh.constant && i < surface.mesh->triangles.size(); ++i)
      middles.push_back(middle_of(*surface.mesh, i));
    const TetMesh sampled{mesh.points, mesh.values_of(attribute), mesh.tetrahedra, mesh.constant};
    surface.values = std::make_shared<const SurfaceValues>(
        attribute, "", 0, sample_mesh(sampled, mesh.constant ? middles : surface.mesh->points), mesh.constant);
  }
}

// Draws the volume in front of each layer of surfaces, and joins all.
Result<ReferencePicture> render_with_progress(const Mesh& mesh, const Scene& scene, std::span<const Surface> surfaces,
                                              unsigned threads) {
  ProgressBar bar("draw");
  const TetMesh tet_mesh = mesh.view(scene);
  SPLATVOL_TRY_ASSIGN(view, make_view(scene));
  SPLATVOL_TRY_ASSIGN(slices, draw_slices(tet_mesh, view, scene.transfer_function));
  const SurfaceLayers drawn = draw_surfaces(surfaces, slices, view, std::numeric_limits<std::size_t>::max());
  const auto render = [&](std::size_t done, const SurfaceDepths* depths) {
    const double pictures = std::max<double>(1, static_cast<double>(drawn.layers.size()));
    return render_reference(
        tet_mesh, scene,
        {static_cast<int>(threads),
         [&, done](double fraction) { bar.update((static_cast<double>(done) + fraction) / pictures); }, depths});
  };
  if (drawn.layers.empty()) return render(0, nullptr);
  SurfaceComposite composite;
  ReferencePicture last;
  for (std::size_t i = 0; i < drawn.layers.size(); ++i) {
    SPLATVOL_TRY_ASSIGN(picture, render(i, &drawn.layers[i].depths));
    composite.add(picture.image, drawn.layers[i]);
    last = std::move(picture);
  }
  last.image = composite.finish();
  return last;
}

// `seconds`: of each drawing, sorted.
void print_summary(const Options& options, const Mesh& mesh, const ReferencePicture& picture,
                   const std::vector<double>& seconds) {
  const double median = seconds[seconds.size() / 2];
  const double segments_per_pixel =
      static_cast<double>(picture.segments) / static_cast<double>(picture.image.pixels.size());
  if (!options.json) {
    print_out("{}: {} x {} pixels, {} tetrahedra, {:.1f} segments a pixel, {:.2f} s\n", options.output,
              picture.image.width, picture.image.height, mesh.tetrahedra.size(), segments_per_pixel, median);
    return;
  }
  const nlohmann::ordered_json document = {{"width", picture.image.width},
                                           {"height", picture.image.height},
                                           {"points", mesh.points.size()},
                                           {"tetrahedra", mesh.tetrahedra.size()},
                                           {"segments_per_pixel", segments_per_pixel},
                                           {"seconds", median},
                                           {"seconds_min", seconds.front()},
                                           {"seconds_max", seconds.back()}};
  fmt::print("{}\n", json_text(document, 1));
}

Status draw(const Options& options) {
  std::vector<std::string> inputs = options.meshes;
  inputs.push_back(options.scene);
  SPLATVOL_TRY(check_outputs({options.output}, inputs));
  SPLATVOL_TRY_ASSIGN(scene, load_scene(options.scene, options.size));
  if (std::ranges::any_of(scene.streamlines, &SceneStreamlines::shown))
    return fail(ErrorCode::unsupported, "{}: svtruth draws no streamlines: leave \"streamlines\" out", options.scene);
  SPLATVOL_TRY_ASSIGN(reader_options, reader_options_of(options.reading, options.threads));
  SourceOptions source_options{
      .cells = cell_values_of(options.cells), .missing = options.missing, .displacements = !options.no_displacements};
  source_options.patches = std::ranges::any_of(
      scene.surfaces, [](const SceneSurface& surface) { return surface.shown && !surface.boundary.empty(); });
  std::optional<BoundaryFaces> faces;
  if (source_options.patches) {
    SPLATVOL_TRY_ASSIGN(created, BoundaryFaces::create(memory_limit() / 16, folder_of(options.output)));
    faces.emplace(std::move(created));
  }
  SPLATVOL_TRY_ASSIGN(mesh,
                      read_mesh(options.meshes, scene, source_options, reader_options, faces ? &*faces : nullptr));
  SPLATVOL_TRY_ASSIGN(boundary, faces ? whole_boundary(*faces) : Result<Boundary>(Boundary()));
  SPLATVOL_TRY_ASSIGN(surfaces,
                      read_surfaces(scene.surfaces, {surface_reader(reader_options), [&](const std::string& pattern) {
                                                       return join_patches(options.meshes.front(), pattern, boundary);
                                                     }}));
  add_values(mesh, surfaces);

  Result<ReferencePicture> picture;
  std::vector<double> seconds;
  for (int i = 0; i < options.repeat; ++i) {
    const double start = seconds_now();
    picture = render_with_progress(mesh, scene, surfaces, options.threads);
    if (!picture) return fail_in(options.meshes.front(), picture.error());
    seconds.push_back(seconds_now() - start);
  }
  std::ranges::sort(seconds);

  const Provenance provenance = {{"software", "svtruth " SPLATVOL_VERSION},
                                 {"mesh", fmt::format("{}", fmt::join(options.meshes, " "))},
                                 {"scene", options.scene},
                                 {"attribute", scene.attribute}};
  SPLATVOL_TRY(write_image(options.output, picture->image, scene.background, provenance));
  print_summary(options, mesh, *picture, seconds);
  return {};
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using namespace splatvol;
  CommandLine app("Draws the exact picture of a mesh: every tetrahedron on every pixel's ray, in double precision.",
                  "svtruth");
  Options options;
  app.add_option(
         "MESH", options.meshes,
         "Any input of svbuild that has cells: .vtu, .pvtu, .vtk, a folder of pieces, a PLOT3D grid and its solution, "
         "or gen:mesh:cells=1e7")
      ->type_name("IN...")
      ->required();
  app.add_option("--scene", options.scene, "Scene file (JSON)")->type_name("S.json")->required();
  app.add_option("-o,--output", options.output, "Picture to write: .exr or .png")
      ->type_name("OUT")
      ->required()
      ->check(check_image_path);
  app.add_option("--size", options.size, "Size of the picture in pixels, instead of the scene's")
      ->type_name("WxH")
      ->check(check_of(parse_image_size));
  add_cells_option(app, options.cells, "draw constant cells, as 'svbuild --cells own' has them");
  add_displacements_option(app, options.no_displacements);
  app.add_option("--missing", options.missing, "As in svbuild: a number that stands for no value; repeatable")
      ->type_name("V")
      ->allow_extra_args(false);
  app.add_option("--threads", options.threads, "Threads; 0: all")->range(0u, 4096u);
  app.add_option("--repeat", options.repeat, "Pictures to draw for the time in the summary, which is their median")
      ->range(1, 1000000);
  add_reading_options(app, options.reading);
  app.add_flag("--json", options.json, "Print the summary as JSON");
  return run_tool(app, argc, argv, [&] { return draw(options); });
}
