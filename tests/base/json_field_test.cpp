#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "base/json.h"

namespace splatvol {
namespace {

using nlohmann::json;

template <class T>
std::string error_of(const Result<T>& result) {
  return result ? "none" : result.error().message;
}

struct JsonFields : testing::Test {
  const json document_ = json::parse(R"({
    "size": 7, "part": 0.5, "large": 18446744073709551615, "name": "a\nb", "shown": true, "none": null,
    "camera": {"up": [0, 1, "x"], "x-own": 1},
    "list": [{"size": 1}, {"size": 2.0}]})");
  const JsonField root_{document_};
};

TEST_F(JsonFields, HaveValues) {
  EXPECT_EQ(root_.member("part").number().value(), 0.5);
  EXPECT_EQ(root_.member("size").whole(0, 7).value(), 7);
  EXPECT_EQ(root_.member("large").whole(std::uint64_t{0}, ~std::uint64_t{0}).value(), ~std::uint64_t{0});
  EXPECT_EQ(root_.member("name").text().value(), "a\nb");
  EXPECT_TRUE(root_.member("shown").truth().value());
  EXPECT_TRUE(std::isnan(root_.member("none").number_or_nan().value()));
  const JsonField camera = root_.member("camera"), list = root_.member("list");
  EXPECT_EQ(camera.member("x-own").number_or_nan().value(), 1);
  EXPECT_EQ(camera.json(), R"({"up":[0,1,"x"],"x-own":1})");
  EXPECT_EQ(list.size(), 2U);
  EXPECT_EQ(camera.size(), 0U) << "no list";
  EXPECT_TRUE(root_.is_object() && list.is_list() && root_.member("none").is_null());
  const auto sizes = list.each([](const JsonField& one) { return one.member("size").number(); });
  EXPECT_EQ(sizes.value(), (std::vector<double>{1, 2}));
}

TEST_F(JsonFields, ErrorsNameThePath) {
  const JsonField camera = root_.member("camera"), up = camera.member("up"), list = root_.member("list");
  EXPECT_EQ(error_of(up.numbers(3)), "camera.up[2]: not a number");
  EXPECT_EQ(error_of(up.numbers(2)), "camera.up: not a list of 2 numbers");
  EXPECT_EQ(error_of(up.text()), "camera.up: not a string");
  EXPECT_EQ(error_of(up.truth()), "camera.up: neither true nor false");
  EXPECT_EQ(error_of(root_.member("part").number(0.25)), "part: beyond 0.25");
  EXPECT_EQ(error_of(root_.member("size").whole(8, 9)), "size: not a whole number from 8 to 9");
  EXPECT_EQ(error_of(root_.member("part").whole(0, 9)), "part: not a whole number from 0 to 9");
  EXPECT_EQ(error_of(list.each([](const JsonField& one) { return one.member("size").whole(0, 9); })),
            "list[1].size: not a whole number from 0 to 9")
      << "written with a fraction";
  EXPECT_EQ(error_of(camera.each(&JsonField::text)), "camera: not a list");
  EXPECT_EQ(root_.text().error().code, ErrorCode::invalid_data);
  EXPECT_EQ(error_of(root_.text()), "not a string") << "the whole document has no name";
  EXPECT_EQ(root_.member("name").wrong("'{}' is odd", root_.member("name").text().value()).value().message,
            "name: 'a?b' is odd");
}

TEST_F(JsonFields, MissingFieldsSaySoWhoeverReads) {
  const JsonField lens = root_.member("lens"), glass = lens.member("glass"), list = root_.member("list");
  EXPECT_FALSE(lens.exists() || root_.has("lens") || lens.is_object() || lens.is_list() || lens.is_null());
  EXPECT_EQ(error_of(lens.number()), "lens: missing");
  EXPECT_EQ(error_of(lens.number_or_nan()), "lens: missing");
  EXPECT_EQ(error_of(lens.check_names({})), "lens: missing");
  EXPECT_EQ(lens.wrong("too thick").value().message, "lens: missing");
  EXPECT_EQ(error_of(glass.text()), "lens: missing");
  EXPECT_EQ(error_of(list.element(2).text()), "list[2]: missing");
  EXPECT_EQ(error_of(list.member("size").number()), "list: not an object");
}

TEST_F(JsonFields, MisspeltNamesAreToldWithTheNearest) {
  const JsonField camera = root_.member("camera"), list = root_.member("list"), first = list.element(0);
  EXPECT_TRUE(camera.check_names({"up", "down"})) << "x- is for names of one's own";
  EXPECT_EQ(error_of(camera.check_names({"down", "ups"})),
            "camera.up: no such field; the nearest is camera.ups (names of your own begin with x-)");
  EXPECT_EQ(error_of(first.check_names({"width", "sizes"})),
            "list[0].size: no such field; the nearest is list[0].sizes (names of your own begin with x-)");
  EXPECT_EQ(error_of(list.check_names({})), "list: not an object");
}

TEST(JsonNumbers, AreFinite) {
  const json document = {std::nan(""), HUGE_VAL};
  EXPECT_EQ(error_of(JsonField(document).each([](const JsonField& number) { return number.number(); })),
            "[0]: not finite");
}

TEST(JsonTexts, AreCheckedBeforeTheyAreRead) {
  const auto size = [](const JsonField& root) -> Result<std::size_t> { return root.size(); };
  EXPECT_EQ(read_json("[[1], 2]", size, 2).value(), 2U);
  EXPECT_EQ(error_of(read_json("[[1], 2]", size, 1)), "nested deeper than 1 levels");
  EXPECT_EQ(error_of(read_json(std::string(1'000'000, '['), size, 32)), "nested deeper than 32 levels");
  for (const char* text : {"", "[", "[1e999]", "\"\xff\"", "[] []"})
    EXPECT_TRUE(error_of(read_json(text, size, 9)).starts_with("not JSON: ")) << text;
}

}  // namespace
}  // namespace splatvol
