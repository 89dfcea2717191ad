// Exports lose no mass and keep fields, and VTK and OpenVDB can read them.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openvdb/openvdb.h>
#include <tbb/global_control.h>
#include <vtkNew.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLUnstructuredGridReader.h>
#include <vtkXMLUnstructuredGridWriter.h>

#include <cmath>
#include <filesystem>
#include <map>
#include <numeric>

#include "base/file.h"
#include "base/vdb_grid.h"
#include "base/vdb_share.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "builder/scattered/scattered.h"
#include "builder/sources/generator.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test_volume.h"
#include "tools/export/vdb_export.h"
#include "tools/export/vtu_export.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

constexpr std::uint64_t enough = std::uint64_t{1} << 30;
const auto no_progress = [](double) {};

struct Export : FolderTest {
  std::shared_ptr<const format::Volume> open(const std::string& name) const {
    return format::Volume::open(open_file(path(name)).value()).value();
  }

  std::shared_ptr<const format::Volume> build(Source& source, const std::string& name,
                                              BuildOptions options = {}) const {
    options.memory = 64 << 20;
    EXPECT_TRUE(build_volume(source, path(name), options, [](const char*, double) {}).has_value());
    return open(name);
  }

  /// Splats of any shape, some without mass, with some values missing, far from the origin.
  std::shared_ptr<const format::Volume> random_volume(const dvec3& origin = dvec3(0)) const {
    std::vector<dvec3> positions = random_points(600, 7u);
    std::vector<std::vector<double>> values(2);
    for (const dvec3& p : positions) {
      values[0].push_back(p.x + p.y);
      values[1].push_back(p.z > 0.8 ? std::nan("") : p.z);
    }
    for (dvec3& p : positions) p += origin;
    TestVolumeOptions options;
    options.cube.origin = origin;
    EXPECT_TRUE(write_test_volume(make_test_volume(positions, values, options), path("random.svol")));
    return open("random.svol");
  }

  openvdb::FloatGrid::Ptr grid(const std::string& file, const std::string& name) const {
    openvdb::initialize();
    openvdb::io::File vdb(path(file));
    vdb.open(false);
    return openvdb::gridPtrCast<openvdb::FloatGrid>(vdb.readGrid(name));
  }
};

/// Selects splats of all of the volume. Without a resolution: the finest. Without names: all attributes.
format::SplatSelection selected(const format::Volume& volume, std::optional<std::size_t> resolution = {},
                                const std::vector<std::string>& names = {}) {
  return format::select_splats(volume, resolution, names, format::SplatSelection().box).value();
}

double mass_of(const format::Volume& volume, std::size_t resolution) {
  const format::SplatSelection selection = selected(volume, resolution);
  double mass = 0;
  const auto add = [&](const format::SplatGroup& group) -> Status {
    for (const SplatShape& shape : group.shapes) mass += shape.mass;
    return {};
  };
  EXPECT_TRUE(for_each_group(format::SplatReader(volume, selection, own_room(format::splat_reader_bytes)),
                             {.material = true}, add, no_progress));
  return mass;
}

double mass_of(const openvdb::FloatGrid& grid) {
  double sum = 0;
  for (auto value = grid.cbeginValueOn(); value; ++value) sum += static_cast<double>(*value);
  return sum * grid.transform().voxelSize().product();
}

// A box of voxels with a linear value.
std::string write_linear_box(const std::string& path, const dvec3& origin) {
  openvdb::initialize();
  const auto grid = make_vdb_grid<openvdb::FloatGrid>();
  grid->setName("value");
  grid->setTransform(openvdb::math::Transform::createLinearTransform(0.5));
  grid->transform().postTranslate({origin.x, origin.y, origin.z});
  const openvdb::CoordBBox box(openvdb::Coord(0), openvdb::Coord(19));
  for (auto at = box.begin(); at; ++at) grid->tree().setValueOn(*at, static_cast<float>(2 * (*at).x() - (*at).y() + 3));
  openvdb::io::File(path).write(openvdb::GridPtrVec{grid});
  return path;
}

// Random roundings of single precision, 2^-24 each, add up to far less than 1e-5.
TEST_F(Export, VoxelsHoldTheWholeMass) {
  for (const dvec3 origin : {dvec3(0), dvec3(1e7, -1e7, 1e7)}) {
    const auto volume = random_volume(origin);
    for (const double voxel : origin == dvec3(0) ? std::vector{0.3, 0.05} : std::vector{0.3, 0.05, 0.011})
      for (std::size_t r = 0; r < volume->info().resolutions(); ++r) {
        const auto selection = selected(*volume, r);
        const VdbReport report = export_vdb(*volume, path("out.vdb"), selection, voxel, enough, no_progress).value();
        const double mass = mass_of(*volume, r);
        EXPECT_NEAR(report.splat_mass, mass, 1e-12 * mass);
        EXPECT_NEAR(report.voxel_mass, mass, 1e-11 * mass);
        const auto fraction = grid("out.vdb", "volume_fraction");
        EXPECT_NEAR(mass_of(*fraction), mass, 1e-5 * mass);
        EXPECT_EQ(fraction->activeVoxelCount(), report.voxels);
        EXPECT_TRUE(fraction->metaValue<bool>(vdb_share_metadata));
        const auto bounds = fraction->evalActiveVoxelBoundingBox();
        const auto low = fraction->indexToWorld(bounds.min());
        for (int k = 0; k < 3; ++k) EXPECT_NEAR(low[k], origin[k] + 0.5, 2.5) << "a cube of edge 1";
      }
  }
}

TEST_F(Export, ValuesStayInTheirRangeAndMissingOnesAreNotThere) {
  const auto volume = random_volume();
  const auto selection = selected(*volume, std::nullopt, {"a1"});
  ASSERT_TRUE(export_vdb(*volume, path("out.vdb"), selection, 0.05, enough, no_progress));
  const auto values = grid("out.vdb", "a1");
  EXPECT_LT(values->activeVoxelCount(), grid("out.vdb", "volume_fraction")->activeVoxelCount());
  const format::Attribute& attribute = volume->info().attributes[1];
  for (auto value = values->cbeginValueOn(); value; ++value) {
    EXPECT_GE(*value, attribute.min);
    EXPECT_LE(*value, attribute.max);
  }
}

// Exports voxels to equal voxels at the same positions. Each inner voxel gives as much mass as it gets, and by symmetry
// a linear field stays. Codes of mass are within 0.3 %, those of value moments within 1/127 of a deviation of 0.65. The
// blur of a voxel flattens slopes. Voxels of 0.2 lose a seventh, or a twentieth of what a voxel adds.
TEST_F(Export, ALinearFieldComesBack) {
  for (const dvec3 origin : {dvec3(0), dvec3(1e7, -1e7, 1e7)}) {
    const auto source = open_source({write_linear_box(path("in.vdb"), origin)}, {}).value();
    const auto volume = build(*source, "box.svol");
    const auto selection = selected(*volume);
    for (const double voxel : {0.5, 0.2}) {
      ASSERT_TRUE(export_vdb(*volume, path("out.vdb"), selection, voxel, enough, no_progress));
      const auto value = grid("out.vdb", "value"), fraction = grid("out.vdb", "volume_fraction");
      std::size_t inside = 0;
      for (auto at = value->cbeginValueOn(); at; ++at) {
        const openvdb::Vec3d world = value->indexToWorld(at.getCoord());
        const dvec3 index = (dvec3(world.x(), world.y(), world.z()) - origin) / 0.5;
        if (glm::any(glm::lessThan(index, dvec3(3))) || glm::any(glm::greaterThan(index, dvec3(16)))) continue;
        ++inside;
        EXPECT_NEAR(*at, 2 * index.x - index.y + 3, 0.12);
        if (voxel == 0.5) {
          EXPECT_NEAR(fraction->tree().getValue(at.getCoord()), 1, 0.005);
        }
      }
      EXPECT_GE(inside, static_cast<std::size_t>(std::pow(6.4 / voxel, 3)));
    }
  }
}

TEST_F(Export, TheMassOfVoxelsSurvivesTheWayBack) {
  const auto volume = random_volume();
  const auto selection = selected(*volume, std::nullopt, {"a0"});
  ASSERT_TRUE(export_vdb(*volume, path("out.vdb"), selection, 0.05, enough, no_progress));
  const auto source = open_source({path("out.vdb")}, {{"a0"}, {}}).value();
  const auto back = build(*source, "back.svol");
  const double mass = mass_of(*volume, volume->info().resolutions() - 1);
  // Codes of mass are rounded up or down, by a factor of up to 2^(1/256).
  for (std::size_t r = 0; r < back->info().resolutions(); ++r) EXPECT_NEAR(mass_of(*back, r), mass, 3e-3 * mass);
}

TEST_F(Export, ABoxIsThePartOfTheWhole) {
  const auto volume = random_volume();
  const Box box{dvec3(0.2, 0.2, 0.2), dvec3(0.6, 0.7, 0.8)};
  const auto all = selected(*volume, std::nullopt, {"a0"});
  const auto part = format::select_splats(*volume, std::nullopt, {"a0"}, box).value();
  ASSERT_TRUE(export_vdb(*volume, path("all.vdb"), all, 0.04, enough, no_progress));
  ASSERT_TRUE(export_vdb(*volume, path("part.vdb"), part, 0.04, enough, no_progress));
  const auto whole = grid("all.vdb", "volume_fraction"), cut = grid("part.vdb", "volume_fraction");
  std::size_t inside = 0;
  for (auto value = whole->cbeginValueOn(); value; ++value) {
    const openvdb::Vec3d at = whole->indexToWorld(value.getCoord());
    const dvec3 p(at.x(), at.y(), at.z());
    const bool is_inside = glm::all(glm::lessThanEqual(box.low, p)) && glm::all(glm::lessThanEqual(p, box.high));
    EXPECT_EQ(cut->tree().isValueOn(value.getCoord()), is_inside);
    if (!is_inside) continue;
    ++inside;
    EXPECT_NEAR(cut->tree().getValue(value.getCoord()), *value, 1e-6F * *value);
  }
  EXPECT_EQ(cut->activeVoxelCount(), inside);
  EXPECT_GT(inside, 100u);
}

TEST_F(Export, BytesDoNotDependOnThreadsOrMemory) {
  const auto volume = random_volume();
  const auto selection = selected(*volume);
  const auto export_with = [&](std::size_t threads, std::uint64_t memory) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    EXPECT_TRUE(export_vdb(*volume, path("out.vdb"), selection, 0.05, memory, no_progress));
    EXPECT_TRUE(export_vtu(*volume, path("out.vtu"), selection, no_progress));
    return std::pair(read_text_file(path("out.vdb")).value(), read_text_file(path("out.vtu")).value());
  };
  const auto once = export_with(1, enough), again = export_with(4, enough / 4);
  EXPECT_TRUE(once.first == again.first);
  EXPECT_TRUE(once.second == again.second);
}

TEST_F(Export, RefusesWhatCannotBe) {
  const auto volume = random_volume();
  const Box all = format::SplatSelection().box;
  EXPECT_THAT(format::select_splats(*volume, 99, {}, all).error().message,
              HasSubstr("no resolution 99; the finest is"));
  EXPECT_THAT(format::select_splats(*volume, 0, {"x"}, all).error().message,
              HasSubstr("no attribute \"x\"; there are: a0, a1"));
  const auto selection = format::select_splats(*volume, std::nullopt, {}, all).value();

  const auto refused = [&](double voxel, std::uint64_t memory) {
    const auto report = export_vdb(*volume, path("out.vdb"), selection, voxel, memory, no_progress);
    EXPECT_FALSE(report.has_value());
    EXPECT_FALSE(std::filesystem::exists(path("out.vdb")));
    return report ? Error{} : report.error();
  };
  const Error budget = refused(0.01, 1 << 20);
  EXPECT_EQ(budget.code, ErrorCode::out_of_budget);
  EXPECT_THAT(budget.message, HasSubstr("--memory"));
  EXPECT_EQ(refused(1e-5, 1 << 20).code, ErrorCode::out_of_budget) << "one splat alone has too many voxels";
  EXPECT_THAT(refused(1e-12, enough).message, HasSubstr("cannot be numbered"));

  const auto outside = format::select_splats(*volume, std::nullopt, {}, {dvec3(50), dvec3(60)}).value();
  EXPECT_THAT(export_vdb(*volume, path("out.vdb"), outside, 0.1, enough, no_progress).error().message,
              HasSubstr("no material"));
  EXPECT_THAT(export_vtu(*volume, path("out.vtu"), outside, no_progress).error().message, HasSubstr("no points"));
}

// An attribute keeps its name, whatever it is called; the array or grid of the material gets another.
TEST_F(Export, AttributesKeepTheirNames) {
  const auto points = random_points(50, 1u);
  const auto volume_with = [&](const std::vector<std::string>& names) {
    std::vector<std::vector<double>> values(names.size());
    for (std::size_t a = 0; a < names.size(); ++a) values[a].assign(points.size(), 100.0 + static_cast<double>(a));
    TestVolume volume = make_test_volume(points, values);
    for (std::size_t a = 0; a < names.size(); ++a) volume.info.attributes[a].name = names[a];
    EXPECT_TRUE(write_test_volume(volume, path("named.svol")));
    return open("named.svol");
  };
  // Those behind "mean" are arrays of the material for the first attribute, or what such an array is called then.
  const std::vector<std::string> names = {"p",      "mass",        "mass (splat)", "centroid",   "covariance",
                                          "p mean", "p deviation", "p covariance", "p gradient", "p mean mean"};
  const auto clashing = volume_with(names);
  const auto selection = selected(*clashing);
  const VtuReport report = export_vtu(*clashing, path("out.vtu"), selection, no_progress).value();
  const std::map<std::string, std::string> renamed = {{"mass", "mass (splat 2)"},
                                                      {"centroid", "centroid (splat)"},
                                                      {"covariance", "covariance (splat)"},
                                                      {"p mean", "p mean (splat)"},
                                                      {"p deviation", "p deviation (splat)"},
                                                      {"p covariance", "p covariance (splat)"},
                                                      {"p gradient", "p gradient (splat)"},
                                                      {"p mean mean", "p mean mean (splat)"}};
  EXPECT_EQ(report.renamed, renamed);
  const auto source = open_source({path("out.vtu")}, {}).value();
  const auto piece = source->next().value();
  const auto sum_of = [&](const std::string& name) {
    const auto found = std::ranges::find(source->attributes(), name);
    EXPECT_NE(found, source->attributes().end()) << name;
    const auto& values = piece->values[static_cast<std::size_t>(found - source->attributes().begin())];
    return std::accumulate(values.begin(), values.end(), 0.0);
  };
  for (std::size_t a = 0; a < names.size(); ++a)
    EXPECT_NEAR(sum_of(names[a]), (100.0 + static_cast<double>(a)) * 50, 1e-3) << names[a];
  EXPECT_NEAR(sum_of("mass (splat 2)"), report.mass, 1e-9 * report.mass);

  const auto fractions = volume_with({"volume_fraction", "volume_fraction (splat)"});
  const auto grids = selected(*fractions);
  const VdbReport voxels = export_vdb(*fractions, path("out.vdb"), grids, 0.1, enough, no_progress).value();
  EXPECT_EQ(voxels.renamed.at("volume_fraction"), "volume_fraction (splat 2)");
  EXPECT_NEAR(mass_of(*grid("out.vdb", "volume_fraction (splat 2)")), voxels.voxel_mass, 1e-5 * voxels.voxel_mass);
  EXPECT_NEAR(grid("out.vdb", "volume_fraction")->cbeginValueOn().getValue(), 100, 1e-3);
  EXPECT_NEAR(grid("out.vdb", "volume_fraction (splat)")->cbeginValueOn().getValue(), 101, 1e-3);
  const auto back = open_source({path("out.vdb")}, {}).value();
  EXPECT_THAT(back->attributes(),
              UnorderedElementsAre("volume_fraction", "volume_fraction (splat)", "volume_fraction (splat 2)"));
}

TEST_F(Export, TwoAttributesOfOneNameAreRefused) {
  const auto volume = random_volume();
  const auto box = format::SplatSelection().box;
  const auto twice = format::select_splats(*volume, std::nullopt, {"a0", "a0"}, box).value();
  EXPECT_THAT(export_vtu(*volume, path("out.vtu"), twice, no_progress).error().message, HasSubstr("\"a0\""));
  EXPECT_THAT(export_vdb(*volume, path("out.vdb"), twice, 0.1, enough, no_progress).error().message,
              HasSubstr("\"a0\""));
  auto alike = format::select_splats(*volume, std::nullopt, {"a0", "a1"}, box).value();
  alike.names = {"a\x01", "a\x02"};  // XML has neither
  EXPECT_THAT(export_vtu(*volume, path("out.vtu"), alike, no_progress).error().message, HasSubstr("\"a?\""));
}

// An export is replaced by the next one. A file that VTK or OpenVDB has written anew may hold work of the user.
TEST_F(Export, WhatAnotherProgramHasSavedIsNotReplaced) {
  const auto volume = random_volume();
  const auto selection = selected(*volume, 0);
  const auto points = [&](Replace replace = Replace::exports) {
    return export_vtu(*volume, path("out.vtu"), selection, no_progress, replace);
  };
  const auto voxels = [&](Replace replace = Replace::exports) {
    return export_vdb(*volume, path("out.vdb"), selection, 0.2, enough, no_progress, replace);
  };
  for (int i = 0; i < 2; ++i) {
    ASSERT_TRUE(points()) << i;
    ASSERT_TRUE(voxels()) << i;
  }

  {
    const vtkNew<vtkXMLUnstructuredGridReader> reader;
    reader->SetFileName(path("out.vtu").c_str());
    reader->Update();
    const vtkNew<vtkXMLUnstructuredGridWriter> writer;
    writer->SetFileName(path("out.vtu").c_str());
    writer->SetInputData(reader->GetOutput());
    ASSERT_EQ(writer->Write(), 1);
  }
  openvdb::initialize();
  openvdb::io::File file(path("out.vdb"));
  file.open(false);
  const openvdb::GridPtrVecPtr grids = file.getGrids();
  const openvdb::MetaMap::Ptr metadata = file.getMetadata();
  file.close();
  EXPECT_EQ(metadata->metaCount(), 1u);
  openvdb::io::File(path("out.vdb")).write(*grids, *metadata);  // with the metadata, as some programs do

  EXPECT_THAT(points().error().message, HasSubstr("--force"));
  EXPECT_THAT(voxels().error().message, HasSubstr("--force"));
  ASSERT_TRUE(points(Replace::any));
  ASSERT_TRUE(voxels(Replace::any));
  EXPECT_TRUE(points());
  EXPECT_TRUE(voxels());
}

// Reads the export back through open_source, which uses VTK.
TEST_F(Export, VtkReadsThePoints) {
  const auto volume = random_volume(dvec3(1e7));
  for (std::size_t r = 0; r < volume->info().resolutions(); ++r) {
    const auto selection = selected(*volume, r);
    const VtuReport report = export_vtu(*volume, path("out.vtu"), selection, no_progress).value();
    EXPECT_EQ(report.points, volume->info().resolution_counts[r]);
    EXPECT_EQ(report.file_bytes, std::filesystem::file_size(path("out.vtu")));
    EXPECT_NEAR(report.mass, mass_of(*volume, r), 1e-12 * report.mass);

    const auto source = open_source({path("out.vtu")}, {}).value();
    const auto piece = source->next().value();
    EXPECT_EQ(piece->census.without_volume, report.points) << "vertices";
    const auto& names = source->attributes();
    const auto values = [&](const std::string& name) -> const std::vector<double>& {
      const auto found = std::ranges::find(names, name);
      EXPECT_NE(found, names.end()) << name;
      return piece->values[static_cast<std::size_t>(found - names.begin())];
    };
    std::size_t i = 0;
    const auto compare = [&](const format::SplatGroup& group) -> Status {
      for (std::size_t k = 0; k < group.size(); ++k, ++i) {
        EXPECT_EQ(piece->points[i], group.positions[k]);
        EXPECT_EQ(values("a0")[i], static_cast<double>(group.values[0][k]));
        EXPECT_EQ(std::isnan(values("a1")[i]), std::isnan(group.values[1][k]));
        EXPECT_EQ(values("mass")[i], group.shapes[k].mass);
        EXPECT_EQ(values("centroid[2]")[i], group.centroids[k].z);
        const dvec3& d = group.shapes[k].deviations;
        const double trace = values("covariance[0]")[i] + values("covariance[1]")[i] + values("covariance[2]")[i];
        EXPECT_NEAR(trace, glm::dot(d, d), 1e-12 * trace);
        const SplatValue& value = group.materials[0][k];
        if (!(value.coverage > 0)) continue;
        EXPECT_EQ(values("a0 mean")[i], value.mean);
        EXPECT_EQ(values("a0 deviation")[i], value.deviation);
        const dvec3 along = value.deviation * value.correlation * d;
        EXPECT_NEAR(values("a0 covariance")[i], glm::length(along), 1e-12 * (glm::length(along) + 1e-300));
      }
      return {};
    };
    const format::SplatReader reader(*volume, selection, own_room(format::splat_reader_bytes));
    EXPECT_TRUE(for_each_group(reader, {.positions = true, .values = true, .material = true}, compare, no_progress));
    EXPECT_EQ(i, report.points);
  }
}

constexpr dvec3 slope(1, -2, 0.5);

// Returns the arrays of an exported resolution, read back by VTK. Vectors have one array for each component.
struct Exported {
  std::vector<dvec3> points;
  std::map<std::string, std::vector<double>> arrays;

  [[nodiscard]] std::vector<dvec3> vectors(const std::string& name) const {
    std::vector<dvec3> result(points.size());
    for (int k = 0; k < 3; ++k)
      for (std::size_t i = 0; i < result.size(); ++i) result[i][k] = arrays.at(fmt::format("{}[{}]", name, k))[i];
    return result;
  }
};

Exported export_and_read(const format::Volume& volume, std::size_t resolution, const std::string& file) {
  const auto selection = selected(volume, resolution);
  EXPECT_TRUE(export_vtu(volume, file, selection, no_progress).has_value());
  const auto source = open_source({file}, {}).value();
  const auto piece = source->next().value();
  Exported result{piece->points, {}};
  for (std::size_t a = 0; a < source->attributes().size(); ++a)
    result.arrays[source->attributes()[a]] = piece->values[a];
  return result;
}

// XML 1.0 has no control characters, surrogates, U+FFFE or U+FFFF, in whatever form. All of its bytes are UTF-8.
TEST_F(Export, NamesOfAllKindsAreXml) {
  const Mesh mesh = jittered(3, 0.1);
  PieceSource source({mesh_piece(mesh, [](dvec3 p) { return p.x; })});
  const auto volume = build(source, "names.svol");
  auto selection = selected(*volume, 0);
  for (const auto& [name, written] : {std::pair<std::string, std::string>{"a<b>&\"c\"", "a&#60;b&#62;&#38;&#34;c&#34;"},
                                      {"\t\n\r\x01", "&#9;&#10;??"},
                                      {"\xef\xbf\xbe \xef\xbf\xbf \xef\xbf\xbd", "? ? \xef\xbf\xbd"},
                                      {"\xed\xa0\x80 \xed\xbf\xbf \xee\x80\x80", "? ? \xee\x80\x80"},
                                      {"\xf0\x9f\x98\x80 \xf4\x90\x80\x80", "\xf0\x9f\x98\x80 ?"},
                                      {"\xc0\x80 \xe0\x80\x80 \xc3", "?? ??? ?"},
                                      {"\xc3\xa9\x7f", "\xc3\xa9\x7f"}}) {
    selection.names[0] = name;
    ASSERT_TRUE(export_vtu(*volume, path("names.vtu"), selection, no_progress).has_value());
    EXPECT_THAT(*read_text_file(path("names.vtu")), HasSubstr("Name=\"" + written + " mean\"")) << written;
  }
}

// Bound on the error of a linear field's gradient from the rounding of codes: correlations within 1/30, deviations of
// values within 4.4 %, and axes that move by 1/16 of a shorter axis.
double gradient_bound(const SplatShape& shape, const SplatValue& value) {
  const dvec3 codes = value.deviation / 30 / shape.deviations;
  return glm::length(codes) + (0.05 + 1.0 / 8) * glm::length(slope);
}

void expect_slope(const format::Volume& volume, std::size_t resolution, const Exported& exported) {
  const auto gradients = exported.vectors("value gradient");
  double squares = 0;
  std::size_t i = 0;
  const auto compare = [&](const format::SplatGroup& group) -> Status {
    for (std::size_t k = 0; k < group.size(); ++k, ++i) {
      const double error = glm::length(gradients[i] - slope);
      EXPECT_LT(error, gradient_bound(group.shapes[k], group.materials[0][k])) << resolution << " " << i;
      squares += error * error;
    }
    return {};
  };
  const auto selection = selected(volume, resolution);
  EXPECT_TRUE(for_each_group(format::SplatReader(volume, selection, own_room(format::splat_reader_bytes)),
                             {.material = true}, compare, no_progress));
  EXPECT_EQ(i, gradients.size());
  EXPECT_LT(std::sqrt(squares / static_cast<double>(i)), 0.06 * glm::length(slope));
}

// Both gradients of a linear field, for every way to join the points. The gradient of the moments is that of the field,
// at every resolution. The file's own gradient sums differences along the edges of tetrahedra, of the mesh or of the
// points' triangulation, and is only about that of the field. Points without tetrahedra have the gradient of the field.
TEST_F(Export, GradientsOfALinearField) {
  const Mesh mesh = jittered(9, 0.3);
  const auto field = [](dvec3 p) { return glm::dot(slope, p); };
  const auto values = sample(mesh, field);
  const auto along = gradients_of({mesh.points, delaunay_tetrahedra(mesh.points).value()}, values);
  struct Case {
    const char* name;
    Connectivity connectivity;
    std::uint64_t held_points;
    std::vector<dvec3> directions;
  };
  const std::vector<dvec3> exact(mesh.points.size(), slope);
  for (const auto& [name, connectivity, held, directions] :
       {Case{"mesh", Connectivity::mesh, enough, gradients_of(mesh, values)},
        Case{"delaunay", Connectivity::delaunay, enough, along},
        Case{"delaunay in blocks", Connectivity::delaunay, 100, along},
        Case{"Voronoi cells", Connectivity::none, enough, exact}, Case{"boxes", Connectivity::boxes, enough, exact}}) {
    SCOPED_TRACE(name);
    PieceSource source({mesh_piece(mesh, field)});
    BuildOptions options{.held_points = held, .gradients = true, .connectivity = connectivity};
    const auto volume = build(source, "linear.svol", options);
    const std::size_t finest = volume->info().resolutions() - 1;
    // Without tetrahedra, the means of cells stay between their neighbours' values, so clusters are not linear.
    for (std::size_t r = connectivity == Connectivity::none || connectivity == Connectivity::boxes ? finest : 0;
         r <= finest; ++r) {
      const Exported exported = export_and_read(*volume, r, path("linear.vtu"));
      expect_slope(*volume, r, exported);
      const auto found = exported.vectors("value gradient direction");
      for (std::size_t i = 0; i < found.size(); ++i) {
        const auto near = std::ranges::min_element(
            mesh.points, {}, [&](const dvec3& p) { return glm::distance(p, exported.points[i]); });
        const dvec3 expected = directions[static_cast<std::size_t>(near - mesh.points.begin())];
        EXPECT_NEAR(glm::length(found[i]), 1, 1e-12);
        EXPECT_LT(glm::distance(found[i], glm::normalize(expected)), std::sqrt(3) / 254 + 1e-4) << i;
      }
    }
  }
}

// A layer without thickness, missing values above it, and points in no cell.
TEST_F(Export, GradientsAreFiniteAndNothingWhereThereIsNoMaterial) {
  Mesh mesh = lattice(8, [](dvec3 p) { return p.z < 0.5 ? dvec3(p.x, p.y, 1e-200 * p.z) : p; });
  for (const dvec3& p : random_points(50, 1u)) mesh.points.push_back(p + dvec3(2, 0, 0));
  const auto field = [](dvec3 p) { return p.z > 0.7 ? std::nan("") : p.x + 1e30 * std::sin(20 * p.y); };
  PieceSource source({mesh_piece(mesh, field)});
  const auto volume = build(source, "odd.svol");
  for (std::size_t r = 0; r < volume->info().resolutions(); ++r) {
    const Exported exported = export_and_read(*volume, r, path("odd.vtu"));
    const auto gradients = exported.vectors("value gradient");
    std::size_t without = 0, with = 0;
    for (std::size_t i = 0; i < gradients.size(); ++i) {
      EXPECT_TRUE(std::isfinite(glm::length(gradients[i]))) << i;
      const bool is_missing = std::isnan(exported.arrays.at("value mean")[i]);
      (is_missing ? without : with) += 1;
      EXPECT_EQ(is_missing, gradients[i] == dvec3(0)) << i;
    }
    EXPECT_GT(without, 20u);
    EXPECT_GT(with, 20u);
  }
}

TEST_F(Export, AFileWithoutDirectionsHasNone) {
  const std::vector<dvec3> positions = random_points(100, 7u);
  TestVolumeOptions options{.gradients = false};
  ASSERT_TRUE(
      write_test_volume(make_test_volume(positions, {std::vector<double>(100, 1.0)}, options), path("old.svol")));
  const Exported exported = export_and_read(*open("old.svol"), 0, path("out.vtu"));
  EXPECT_TRUE(exported.arrays.contains("a0 gradient[0]"));
  EXPECT_FALSE(exported.arrays.contains("a0 gradient direction[0]"));
}

TEST_F(Export, UnitsSurvive) {
  PieceSource source({scattered(random_points(50, 3u))});
  const auto volume = build(source, "units.svol", {.units = {{"value", "kg/m^3"}}});
  EXPECT_EQ(volume->info().attributes[0].unit, "kg/m^3");
  const auto selection = selected(*volume);
  ASSERT_TRUE(export_vtu(*volume, path("out.vtu"), selection, no_progress).has_value());
  const auto back = open_source({path("out.vtu")}, {{"value", "value mean", "mass"}, {}}).value();
  EXPECT_THAT(back->units(), ElementsAre("kg/m^3", "kg/m^3", ""));
  ASSERT_TRUE(export_vdb(*volume, path("out.vdb"), selection, 0.2, enough, no_progress).has_value());
  openvdb::initialize();
  openvdb::io::File file(path("out.vdb"));
  file.open();
  EXPECT_EQ(file.readGridMetadata("value")->metaValue<std::string>("unit"), "kg/m^3");
}

TEST_F(Export, AUnitNeedsItsAttribute) {
  PieceSource source({scattered(random_points(50, 3u))});
  const auto report = build_volume(source, path("out.svol"), {.units = {{"p", "Pa"}}}, [](const char*, double) {});
  ASSERT_FALSE(report.has_value());
  EXPECT_THAT(report.error().message, HasSubstr("no attribute \"p\"; there are: value"));
}

TEST_F(Export, PointsOfABoxBecomeAFileAgain) {
  const auto volume = random_volume();
  const Box box{dvec3(0), dvec3(0.5, 1, 1)};
  const auto selection = format::select_splats(*volume, std::nullopt, {"a0"}, box).value();
  const VtuReport report = export_vtu(*volume, path("out.vtu"), selection, no_progress).value();
  EXPECT_LT(report.points, volume->info().point_count());
  const auto source = open_source({path("out.vtu")}, {{"a0"}, {}}).value();
  const auto back = build(*source, "back.svol");
  EXPECT_EQ(back->info().point_count(), report.points);
  EXPECT_LE(back->info().cube.origin.x + back->info().cube.edge, 1.5);
  EXPECT_TRUE(back->verify([](double) {}).has_value());
}

}  // namespace
}  // namespace splatvol::test
