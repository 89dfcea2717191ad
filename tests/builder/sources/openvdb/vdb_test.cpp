// Voxels from OpenVDB files: the expectations follow from each voxel's box and the linear field in it.
#include "builder/sources/openvdb/vdb_source.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <openvdb/io/Compression.h>
#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <limits>
#include <numeric>
#include <span>
#include <sstream>

#include "base/file.h"
#include "base/vdb_grid.h"
#include "base/vdb_share.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "builder/sources/openvdb/vdb_header.h"
#include "builder/sources/openvdb/vdb_library.h"
#include "format/volume.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"
#include "tests/support/whole_points.h"

namespace splatvol::test {
namespace {

using openvdb::Coord;
using openvdb::CoordBBox;
using namespace ::testing;

struct Vdb : test::FolderTest {
  Vdb() { openvdb::initialize(); }

  std::string path(const std::string& name = "in.vdb") const { return FolderTest::path(name); }

  std::string write(const openvdb::GridPtrVec& grids, const std::string& name = "in.vdb") const {
    openvdb::io::File(path(name)).write(grids);
    return path(name);
  }

  /// Reads a file that has one piece.
  Piece read(const std::vector<std::string>& selection = {}) const {
    const auto source = open_vdb_files({path()}, {selection, {}}).value();
    EXPECT_TRUE(source->brings_material());
    Piece all = *source->next().value();
    while (const auto piece = source->next().value()) ADD_FAILURE() << "small files come in one piece";
    EXPECT_EQ(source->point_count(), all.points.size());
    return all;
  }

  std::string refusal(const std::vector<std::string>& selection = {}) const {
    const auto source = open_vdb_files({path()}, {selection, {}});
    EXPECT_FALSE(source.has_value());
    if (source) return {};
    EXPECT_THAT(source.error().message, HasSubstr(path()));
    return source.error().message;
  }
};

template <class Grid>
typename Grid::Ptr make_grid(const std::string& name, double voxel = 1) {
  const auto grid = make_vdb_grid<Grid>();
  grid->setName(name);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(voxel));
  return grid;
}

template <class Grid>
typename Grid::Ptr one_voxel(const std::string& name, typename Grid::ValueType value,
                             const Coord& voxel = Coord(1, 2, 3)) {
  const auto grid = make_grid<Grid>(name);
  grid->tree().setValueOn(voxel, value);
  return grid;
}

double total_mass(const Piece& piece) {
  return std::accumulate(piece.material->moments.begin(), piece.material->moments.end(), 0.0,
                         [](double sum, const SpatialMoments& m) { return sum + m.mass; });
}

std::array<double, 6> entries(const SymmetricMatrix& m) { return {m.xx, m.yy, m.zz, m.xy, m.xz, m.yz}; }

TEST_F(Vdb, SingleVoxelIsItsBox) {
  const auto grid = one_voxel<openvdb::FloatGrid>("density", 7.0F);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(0.5));
  grid->transform().postTranslate({10, 20, 30});
  write({grid});
  const Piece piece = read();
  ASSERT_EQ(piece.points.size(), 1u);
  EXPECT_EQ(piece.points[0], dvec3(10.5, 21, 31.5));
  EXPECT_THAT(piece.values, ElementsAre(ElementsAre(7.0)));
  const SpatialMoments& moments = piece.material->moments[0];
  EXPECT_DOUBLE_EQ(moments.mass, 0.125);
  EXPECT_EQ(moments.centroid, dvec3(0));
  for (int k = 0; k < 6; ++k)
    EXPECT_NEAR(entries(moments.covariance)[static_cast<std::size_t>(k)], k < 3 ? 0.25 / 12 : 0, 1e-17);
  const ValueMoments& value = piece.material->value_moments[0][0];
  EXPECT_EQ(value.mass, moments.mass);
  EXPECT_EQ(value.mean, 7);
  EXPECT_EQ(value.variance, 0);
  EXPECT_EQ(piece.material->gradients[0][0], dvec3(0));
  // No neighbours: the plane is that of one face, of area 1/4 at a distance of 1/4.
  EXPECT_DOUBLE_EQ(glm::length(piece.material->planes[0].area), 0.25);
  EXPECT_DOUBLE_EQ(piece.material->planes[0].offset, 0.25 * 0.25);
}

// Differences of a linear field are exact, also one-sided ones, up to rounding.
TEST_F(Vdb, LinearFieldInShearedVoxelsIsExact) {
  const openvdb::Mat4d matrix(0.5, 0.1, 0.0, 0.0, 0.2, 2.0, -0.3, 0.0, 0.0, 0.4, -1.0, 0.0, 100.0, -50.0, 25.0,
                              1.0);  // row vectors; mirrored
  const auto grid = make_grid<openvdb::DoubleGrid>("value");
  grid->setTransform(openvdb::math::Transform::createLinearTransform(matrix));
  const dvec3 slope(3, -2, 0.5);
  const auto position = [&](const Coord& at) {
    const openvdb::Vec3d world = grid->indexToWorld(at);
    return dvec3(world.x(), world.y(), world.z());
  };
  const CoordBBox box(Coord(-5, -3, 2), Coord(6, 8, 11));
  for (auto at = box.begin(); at; ++at) grid->tree().setValueOn(*at, 4 + glm::dot(slope, position(*at)));
  write({grid});
  const Piece piece = read();
  ASSERT_EQ(piece.points.size(), box.volume());
  const dmat3 edges(dvec3(0.5, 0.1, 0), dvec3(0.2, 2, -0.3), dvec3(0, 0.4, -1));
  const double volume = std::abs(glm::determinant(edges));
  const dmat3 s = edges * glm::transpose(edges) * (1.0 / 12);
  EXPECT_NEAR(total_mass(piece), volume * static_cast<double>(box.volume()), 1e-9 * total_mass(piece));
  for (std::size_t i = 0; i < piece.points.size(); ++i) {
    const PointMaterial& material = *piece.material;
    EXPECT_NEAR(piece.values[0][i], 4 + glm::dot(slope, piece.points[i]), 1e-10);
    EXPECT_LT(glm::length(material.gradients[0][i] - slope), 1e-9);
    const SymmetricMatrix& covariance = material.moments[i].covariance;
    EXPECT_NEAR(covariance.xx, s[0][0], 1e-12);
    EXPECT_NEAR(covariance.yz, s[1][2], 1e-12);
    EXPECT_LT(glm::length(material.value_moments[0][i].covariance - s * slope), 1e-9);
    EXPECT_NEAR(material.value_moments[0][i].variance, glm::dot(slope, s * slope), 1e-9);
    // The centre is half of the box's height away from a face, whatever the shear.
    const BoundaryPlane& plane = material.planes[i];
    EXPECT_NEAR(plane.offset, plane.area != dvec3(0) ? volume / 2 : 0, 1e-9);
  }
}

TEST_F(Vdb, PlanesAreWhereNothingIsActive) {
  const auto grid = make_grid<openvdb::FloatGrid>("value");
  grid->tree().denseFill(CoordBBox(Coord(0), Coord(9)), 1.0F);
  write({grid});
  const Piece piece = read();
  for (std::size_t i = 0; i < piece.points.size(); ++i) {
    const dvec3 p = piece.points[i], area = piece.material->planes[i].area;
    const double inside = std::min({p.x, p.y, p.z, 9 - p.x, 9 - p.y, 9 - p.z});
    EXPECT_EQ(area != dvec3(0), inside == 0);
    EXPECT_GE(glm::dot(area, p - dvec3(4.5)), 0) << "outwards";
  }
}

TEST_F(Vdb, FarFromTheOriginNothingIsLost) {
  const auto grid = make_grid<openvdb::FloatGrid>("value", 0.001);
  grid->transform().postTranslate({1e7, -1e7, 1e7});
  for (int i = 0; i < 4; ++i) grid->tree().setValueOn(Coord(i, 0, 0), static_cast<float>(i));
  write({grid});
  const Piece piece = read();
  ASSERT_EQ(piece.points.size(), 4u);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(piece.points[i].x, 1e7 + 0.001 * static_cast<double>(i), 4e-9);  // two roundings at 1e7
    EXPECT_DOUBLE_EQ(piece.material->moments[i].mass, 1e-9);
    EXPECT_NEAR(piece.material->gradients[0][i].x, 1000, 1e-6);
  }
}

TEST_F(Vdb, TilesAreBoxes) {
  const auto grid = make_grid<openvdb::FloatGrid>("value", 2);
  grid->fill(CoordBBox(Coord(0), Coord(127)), 3.0F);                // one tile of 128 voxels each way
  grid->fill(CoordBBox(Coord(128, 0, 0), Coord(135, 7, 7)), 5.0F);  // one of 8
  grid->tree().setValueOn(Coord(-1, 64, 64), 1.0F);                 // a voxel in the middle of a face
  write({grid});
  const Piece piece = read();
  EXPECT_EQ(piece.census.cells.at("voxel"), 1u);
  EXPECT_EQ(piece.census.cells.at("tile"), 2u);
  EXPECT_DOUBLE_EQ(total_mass(piece), 8.0 * (128.0 * 128 * 128 + 512 + 1));
  for (std::size_t i = 0; i < piece.points.size(); ++i) {
    const double edge = 2 * (piece.values[0][i] == 3 ? 128 : piece.values[0][i] == 5 ? 8 : 1);
    EXPECT_DOUBLE_EQ(piece.material->moments[i].covariance.xx, edge * edge / 12);
    if (piece.values[0][i] != 3) continue;
    EXPECT_EQ(piece.points[i], dvec3(127));
    // Only the middle of the lower face in x has a neighbour: the difference is one-sided, from the centre to the
    // voxel.
    EXPECT_NEAR(piece.material->gradients[0][i].x, (3.0 - 1.0) / (2 * 64.5), 1e-12);
    EXPECT_EQ(piece.material->gradients[0][i].y, 0);
  }
}

TEST_F(Vdb, SeveralGridsShareTheirPoints) {
  const auto a = make_grid<openvdb::FloatGrid>("a");
  const auto b = make_grid<openvdb::Int32Grid>("b");
  a->fill(CoordBBox(Coord(0), Coord(15)), 1.0F);  // eight tiles
  b->tree().setValueOn(Coord(3, 3, 3), 7);        // in one of these tiles, which becomes voxels
  b->tree().setValueOn(Coord(20, 0, 0), 8);       // outside
  write({a, b});
  const Piece piece = read();
  EXPECT_DOUBLE_EQ(total_mass(piece), 16.0 * 16 * 16 + 1);
  EXPECT_EQ(piece.census.cells.at("tile"), 7u);
  EXPECT_EQ(piece.census.cells.at("voxel"), 513u);
  std::size_t with_a = 0, with_b = 0;
  for (std::size_t i = 0; i < piece.points.size(); ++i) {
    with_a += std::isnan(piece.values[0][i]) ? 0 : 1;
    with_b += std::isnan(piece.values[1][i]) ? 0 : 1;
    EXPECT_EQ(piece.material->value_moments[1][i].mass > 0, !std::isnan(piece.values[1][i]));
    EXPECT_EQ(std::isnan(piece.values[0][i]), piece.points[i].x == 20);
  }
  EXPECT_EQ(with_a, 519u);
  EXPECT_EQ(with_b, 2u);
  EXPECT_EQ(read({"b"}).points.size(), 2u);
}

TEST_F(Vdb, VectorsGiveMagnitudeAndComponents) {
  write({one_voxel<openvdb::Vec3SGrid>("U", {2, 3, 6}), one_voxel<openvdb::Int64Grid>("n", -4),
         one_voxel<openvdb::MaskGrid>("mask", true)});
  const auto source = open_vdb_files({path()}, {}).value();
  EXPECT_THAT(source->attributes(), ElementsAre("U", "U[0]", "U[1]", "U[2]", "n"));
  EXPECT_THAT(source->next().value()->values,
              ElementsAre(ElementsAre(7.0), ElementsAre(2.0), ElementsAre(3.0), ElementsAre(6.0), ElementsAre(-4.0)));
  EXPECT_THAT(read({"n", "U[1]"}).values, ElementsAre(ElementsAre(-4.0), ElementsAre(3.0)));
  EXPECT_THAT(refusal({"mask"}), HasSubstr("no attribute \"mask\"; there are: U, U[0], U[1], U[2], n"));
}

TEST_F(Vdb, HalfPrecisionAndNamelessGrids) {
  const auto grid = one_voxel<openvdb::FloatGrid>("", 0.1F);
  grid->setSaveFloatAsHalf(true);
  write({grid});
  EXPECT_EQ(open_vdb_files({path()}, {}).value()->attributes(), std::vector<std::string>{"value"});
  EXPECT_NEAR(read().values[0][0], 0.1, 0.1 / 1024);
}

TEST_F(Vdb, ValuesThatAreNoNumbersAreMissing) {
  const auto grid = make_grid<openvdb::DoubleGrid>("value");
  const std::array<double, 4> values = {1, std::nan(""), 1e300, 4};
  for (int i = 0; i < 4; ++i) grid->tree().setValueOn(Coord(i, 0, 0), values[static_cast<std::size_t>(i)]);
  write({grid});
  const Piece piece = read();
  EXPECT_TRUE(std::isnan(piece.values[0][1]) && std::isnan(piece.values[0][2]));
  EXPECT_EQ(piece.material->value_moments[0][1].mass, 0);
  EXPECT_EQ(piece.material->gradients[0][0], dvec3(0)) << "no neighbour with a value";
}

TEST_F(Vdb, FillValuesAreMissingAndCounted) {
  const auto t = make_grid<openvdb::FloatGrid>("t");
  const auto u = make_grid<openvdb::Vec3SGrid>("U");
  for (int i = 0; i < 6; ++i) {
    t->tree().setValueOn(Coord(i, 0, 0), i == 1 ? 9.96921e36F : i == 3 ? -9999.0F : static_cast<float>(i));
    u->tree().setValueOn(Coord(i, 0, 0), {i == 4 ? -9999.0F : 3.0F, 4, 0});
  }
  u->tree().setValueOn(Coord(5, 0, 0), {std::numeric_limits<float>::quiet_NaN(), 4, 0});
  write({t, u});
  const auto source = open_vdb_files({path()}, {{}, {}, {}, CellValues::averaged, {-9999}}).value();
  const auto piece = source->next().value();
  EXPECT_THAT(source->attributes(), ElementsAre("t", "U", "U[0]", "U[1]", "U[2]"));
  EXPECT_THAT(piece->fills, ElementsAre(2, 1, 1, 0, 0)) << "NaN is no number that was taken for missing";
  for (std::size_t i = 0; i < 6; ++i) {
    const auto x = static_cast<int>(std::lround(piece->points[i].x));
    EXPECT_EQ(std::isnan(piece->values[0][i]), x == 1 || x == 3) << x;
    EXPECT_EQ(std::isnan(piece->values[1][i]), x >= 4) << "a vector with a missing component is missing: " << x;
    if (x < 4) {
      EXPECT_EQ(piece->values[1][i], 5);
    }
  }
}

TEST_F(Vdb, ShareOfVoxelsIsTheirMass) {
  const auto share = make_grid<openvdb::FloatGrid>("fraction", 0.5);
  share->insertMeta(vdb_share_metadata, openvdb::BoolMetadata(true));
  const auto value = make_grid<openvdb::FloatGrid>("value", 0.5);
  share->tree().setValueOn(Coord(0), 0.25F);
  share->tree().setValueOn(Coord(1, 0, 0), 1.5F);
  for (int i = 0; i < 3; ++i) value->tree().setValueOn(Coord(i, 0, 0), 1.0F);
  write({share, value});
  for (const std::vector<std::string>& selection : {std::vector<std::string>{}, {"value"}}) {
    const Piece piece = read(selection);
    ASSERT_EQ(piece.points.size(), 3u);
    EXPECT_DOUBLE_EQ(total_mass(piece), 0.125 * 1.75);
    EXPECT_EQ(piece.material->moments[2].mass, 0);
  }
}

TEST_F(Vdb, RefusesInOneLine) {
  write({one_voxel<openvdb::MaskGrid>("mask", true)});
  EXPECT_THAT(refusal(), HasSubstr("no grid of numbers; there are: mask (bool)"));
  write({});
  EXPECT_THAT(refusal(), HasSubstr("no grids"));
  write({make_grid<openvdb::FloatGrid>("empty")});
  EXPECT_THAT(refusal(), HasSubstr("no active voxels"));

  const auto fine = one_voxel<openvdb::FloatGrid>("fine", 1);
  fine->setTransform(openvdb::math::Transform::createLinearTransform(0.5));
  write({one_voxel<openvdb::FloatGrid>("coarse", 1), fine});
  EXPECT_THAT(refusal(), HasSubstr("the grids \"coarse\" and \"fine\" have different transforms"));
  EXPECT_EQ(read({"fine"}).points.size(), 1u);

  const auto frustum = one_voxel<openvdb::FloatGrid>("view", 1);
  frustum->setTransform(
      openvdb::math::Transform::createFrustumTransform(openvdb::BBoxd({0, 0, 0}, {10, 10, 10}), 0.5, 10, 1));
  write({frustum});
  EXPECT_THAT(refusal(), HasSubstr("is not linear"));

  write({one_voxel<openvdb::FloatGrid>("twice", 1), one_voxel<openvdb::FloatGrid>("twice", 1)});
  EXPECT_EQ(open_vdb_files({path()}, {}).value()->attributes().size(), 2u);
  write({one_voxel<openvdb::Vec3SGrid>("U", {1, 2, 3}), one_voxel<openvdb::FloatGrid>("U[1]", 1)});
  EXPECT_THAT(refusal(), HasSubstr("two attributes are called \"U[1]\""));
}

TEST_F(Vdb, EveryTruncationIsRefused) {
  const auto grid = make_grid<openvdb::FloatGrid>("value");
  for (int i = 0; i < 20; ++i) grid->tree().setValueOn(Coord(i, i, 0), static_cast<float>(i));
  write({grid, one_voxel<openvdb::Vec3SGrid>("U", {1, 2, 3})}, "whole.vdb");
  const std::string whole = read_text_file(path("whole.vdb")).value();
  for (std::size_t bytes = 0; bytes < whole.size(); bytes += bytes < 1000 ? 1 : 11) {
    std::ofstream(path(), std::ios::binary) << whole.substr(0, bytes);
    EXPECT_EQ(refusal().find('\n'), std::string::npos) << bytes;
  }
}

// OpenVDB copies a block of plain values whose length is negative, and then looks if it has the memory.
TEST_F(Vdb, BlocksOfAWrongLengthAreRefused) {
  ASSERT_TRUE(start_vdb());
  for (const std::uint32_t compression : {openvdb::io::COMPRESS_ZIP, openvdb::io::COMPRESS_BLOSC}) {
    const auto grid = make_grid<openvdb::FloatGrid>("value");
    for (int i = 0; i < 512; ++i) grid->tree().setValueOn(Coord(i % 8, i / 8 % 8, i / 64), static_cast<float>(i));
    openvdb::io::File file(path());
    file.setCompression(compression);
    file.write({grid});
    EXPECT_EQ(read().points.size(), 512U);

    // All values of the brick differ, so that its block is the file's last one. The file ends with it.
    const std::string whole = read_text_file(path()).value();
    std::size_t place = whole.size();
    std::int64_t length = 0;
    do {
      place -= 1;
      std::memcpy(&length, &whole[place], std::min(sizeof(length), whole.size() - place));
    } while (place + sizeof(length) + static_cast<std::size_t>(length) != whole.size());
    for (const std::int64_t wrong : {std::int64_t{-1} << 20, std::numeric_limits<std::int64_t>::min(), std::int64_t{0},
                                     std::int64_t{-2047}, std::int64_t{-2049}, std::int64_t{1} << 32}) {
      std::string damaged = whole;
      std::memcpy(&damaged[place], &wrong, sizeof(wrong));
      std::ofstream(path(), std::ios::binary) << damaged << std::string(2 << 20, 'x');
      EXPECT_THAT(refusal(), HasSubstr("gives its length as")) << compression << ' ' << wrong;
    }
  }
}

// A file that was written to a stream does not say where its grids are.
TEST_F(Vdb, FilesOfStreamsAreCheckedToo) {
  std::ostringstream text(std::ios::binary);
  openvdb::io::Stream(text).write({one_voxel<openvdb::FloatGrid>("a", 1), one_voxel<openvdb::FloatGrid>("b", 2)});
  const std::string whole = text.str();
  std::ofstream(path(), std::ios::binary) << whole;
  EXPECT_EQ(open_vdb_files({path()}, {}).value()->attributes(), (std::vector<std::string>{"a", "b"}));
  for (const std::string part : {"Tree_float_5_4_3", "UniformScaleMap"}) {
    std::string damaged = whole;
    damaged[damaged.find(part) - 1] = 0x70;  // the text is said to have 1.8 GB
    std::ofstream(path(), std::ios::binary) << damaged;
    EXPECT_THAT(refusal(), HasSubstr("ends past the end of the file")) << part;
  }
}

/// A file's header, of a version. It says that the name of its grid has so many bytes.
std::string header_of(std::uint32_t version, std::uint32_t name_bytes) {
  std::string text("\x20\x42\x44\x56\0\0\0\0", 8);
  const auto number = [&](std::uint32_t value) { text.append(reinterpret_cast<const char*>(&value), sizeof(value)); };
  const auto word = [&](const std::string& letters) {
    number(static_cast<std::uint32_t>(letters.size()));
    text += letters;
  };
  number(version), number(10), number(0);
  text += '\0';                                        // no offsets of grids
  if (version == 220 || version == 221) text += '\1';  // compressed
  text += std::string(36, 'u');
  number(0), number(1);  // metadata, grids
  number(name_bytes);
  text += "density";
  word("Tree_float_5_4_3"), word("");
  text += std::string(24, '\0');
  if (version >= 222) number(1);
  number(0);
  word("UniformScaleMap");
  return text;
}

TEST(VdbHeader, OldFileVersionsAreCheckedOrRefused) {
  const auto error = [](std::uint32_t version, std::uint32_t name_bytes) {
    const std::string text = header_of(version, name_bytes);
    return message_of(check_vdb_header(*memory_source(std::as_bytes(std::span(text)), "old.vdb")));
  };
  for (const std::uint32_t version : {220, 221, 222, 224}) {
    EXPECT_EQ(error(version, 7), "") << version;
    EXPECT_THAT(error(version, 0x7fffffff), HasSubstr("ends past the end of the file")) << version;
  }
  EXPECT_THAT(error(219, 7), HasSubstr("old.vdb: file version 219 is older than 220"));
  EXPECT_THAT(error(0, 7), HasSubstr("older than 220"));
}

// OpenVDB has no checksums: damage may go unnoticed. Reading must end, and an error must be one line.
TEST_F(Vdb, DamagedHeadersEnd) {
  const auto grid = one_voxel<openvdb::FloatGrid>("value", 1);
  write({grid}, "whole.vdb");
  const std::string whole = read_text_file(path("whole.vdb")).value();
  for (std::size_t byte = 0; byte < std::min<std::size_t>(whole.size(), 700); ++byte) {
    std::string damaged = whole;
    damaged[byte] = static_cast<char>(~damaged[byte]);
    std::ofstream(path(), std::ios::binary) << damaged;
    const auto source = open_vdb_files({path()}, {});
    EXPECT_LT(source ? 0 : source.error().message.size(), path().size() + 300) << byte;
  }
}

TEST_F(Vdb, FilesFollowEachOther) {
  write({one_voxel<openvdb::FloatGrid>("a", 1), one_voxel<openvdb::FloatGrid>("b", 2)}, "1.vdb");
  const Coord other(1, 2, 4);
  write({one_voxel<openvdb::FloatGrid>("a", 3, other), one_voxel<openvdb::FloatGrid>("b", 4, other)}, "2.vdb");
  const auto source = open_source({folder_}, {{"b"}, {}}).value();
  EXPECT_EQ(source->piece_count(), 2u);
  EXPECT_EQ(source->next().value()->values[0][0], 2);
  EXPECT_EQ(source->next().value()->values[0][0], 4);
  EXPECT_FALSE(source->next().value());
  write({one_voxel<openvdb::FloatGrid>("a", 3)}, "2.vdb");
  const auto lacking = open_source({folder_}, {{"b"}, {}}).value();
  EXPECT_TRUE(lacking->next().has_value());
  EXPECT_THAT(lacking->next().error().message, HasSubstr("2.vdb: no attribute \"b\"; there are: a"));
  write({one_voxel<openvdb::FloatGrid>("b", 4)}, "2.vdb");
  const auto series = open_source({folder_}, {{"b"}, {}}).value();
  EXPECT_TRUE(series->next().has_value());
  EXPECT_THAT(series->next().error().message, HasSubstr("--series"));
}

TEST_F(Vdb, GridsThatOnlySomeFilesHave) {
  const auto grid = [](const std::string& name, int x) {
    const auto made = make_grid<openvdb::FloatGrid>(name);
    made->tree().setValueOn(Coord(x, 0, 0), static_cast<float>(x));
    return made;
  };
  write({grid("t", 1)}, "a.vdb");
  write({grid("u", 20), grid("t", 20)}, "b.vdb");
  const auto vector = make_grid<openvdb::Vec3SGrid>("t");
  vector->tree().setValueOn(Coord(40, 0, 0), {3, 4, 0});
  write({vector}, "c.vdb");
  for (const bool a_first : {true, false}) {
    const std::vector<std::string> paths = {path(a_first ? "a.vdb" : "b.vdb"), path(a_first ? "b.vdb" : "a.vdb")};
    for (const std::vector<std::string>& selection : {std::vector<std::string>{}, {"u", "t"}}) {
      const auto source = open_vdb_files(paths, {selection, {}}).value();
      const bool t_first = a_first && selection.empty();
      EXPECT_THAT(source->attributes(), t_first ? ElementsAre("t", "u") : ElementsAre("u", "t"));
      for (int file = 0; file < 2; ++file) {
        const auto piece = source->next().value();
        const bool is_a = a_first == (file == 0);
        EXPECT_EQ(piece->values[t_first ? 0 : 1][0], is_a ? 1 : 20);
        EXPECT_EQ(std::isnan(piece->values[t_first ? 1 : 0][0]), is_a);
      }
      EXPECT_THAT(source->conversions(), ElementsAre("u: missing where a part of the input lacks it"));
    }
  }
  EXPECT_THAT(message_of(open_vdb_files({path("a.vdb"), path("c.vdb")}, {})),
              HasSubstr("c.vdb: the array \"t\" is a vector of 3 components, and a number in "));
  EXPECT_EQ(open_vdb_files({path("a.vdb"), path("b.vdb")}, {{"w"}, {}}).error().message,
            path("a.vdb") + ": no attribute \"w\"; there are: t");
}

TEST_F(Vdb, PiecesAndPointsDoNotDependOnThreads) {
  const auto grid = make_grid<openvdb::FloatGrid>("value", 0.1);
  const CoordBBox box(Coord(0), Coord(79));  // more than a piece
  grid->tree().denseFill(box, 1.0F);
  for (auto value = grid->beginValueOn(); value; ++value)
    value.setValue(static_cast<float>(std::sin(0.1 * value.getCoord().x()) * value.getCoord().y()));
  write({grid});
  const auto read_with = [&](std::size_t threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const auto source = open_vdb_files({path()}, {}).value();
    EXPECT_EQ(source->piece_count(), 2u);
    const Box bounds = source->bounds().value().value();
    auto points = read_points(*source).value();
    EXPECT_EQ(points.summary.box, bounds) << "to the last bit";
    return points;
  };
  const auto one = read_with(1), four = read_with(4);
  ASSERT_EQ(one.points.size(), box.volume());
  EXPECT_TRUE(one.points.positions == four.points.positions);
  EXPECT_TRUE(one.points.values == four.points.values);
  EXPECT_TRUE(one.points.gradients == four.points.gradients);
  ASSERT_EQ(one.points.planes.size(), one.points.size()) << "they come through the sort";
  std::size_t planes = 0;
  for (const BoundaryPlane& plane : one.points.planes) planes += plane.area != dvec3(0) ? 1 : 0;
  EXPECT_EQ(planes, 80u * 80 * 80 - 78 * 78 * 78);
}

TEST_F(Vdb, BecomesAFile) {
  const auto grid = make_grid<openvdb::FloatGrid>("value", 0.1);
  grid->fill(CoordBBox(Coord(0), Coord(23)), 1.0F);
  grid->tree().denseFill(CoordBBox(Coord(24, 0, 0), Coord(39, 23, 23)), 2.0F);
  write({grid});
  const auto source = open_vdb_files({path()}, {}).value();
  const BuildReport report =
      build_volume(*source, path("out.svol"), {.memory = 64 << 20}, [](const char*, double) {}).value();
  EXPECT_EQ(report.connectivity, Connectivity::mesh);
  EXPECT_EQ(report.points.in_no_cell, 0u);
  EXPECT_EQ(report.resolution_counts.back(), 27u + 16 * 24 * 24);
  const auto volume = format::Volume::open(open_file(path("out.svol")).value()).value();
  EXPECT_TRUE(volume->verify([](double) {}).has_value());
}

}  // namespace
}  // namespace splatvol::test
