#include "base/error.h"

#include <gtest/gtest.h>

#include <memory>

#include "base/printable.h"

namespace splatvol {
namespace {

Result<int> parse_digit(char character) {
  if (character < '0' || character > '9') return fail(ErrorCode::invalid_data, "'{}' is not a digit", character);
  return character - '0';
}

Status check_digit(char character, bool& passed) {
  SPLATVOL_TRY(parse_digit(character));
  passed = true;
  return {};
}

Result<int> add_digits(char a, char b) {
  SPLATVOL_TRY_ASSIGN(first, parse_digit(a));
  SPLATVOL_TRY_ASSIGN(second, parse_digit(b));
  return first + second;
}

TEST(Error, TryReturnsTheErrorAndGoesOnWithoutOne) {
  bool passed = false;
  EXPECT_TRUE(check_digit('7', passed));
  EXPECT_TRUE(passed);

  passed = false;
  const Status failed = check_digit('x', passed);
  ASSERT_FALSE(failed);
  EXPECT_FALSE(passed);
  EXPECT_EQ(failed.error().code, ErrorCode::invalid_data);
  EXPECT_EQ(failed.error().message, "'x' is not a digit");
}

TEST(Error, TryAssignDeclaresTheValue) {
  EXPECT_EQ(add_digits('3', '4').value(), 7);
  EXPECT_EQ(add_digits('3', 'y').error().message, "'y' is not a digit");
  EXPECT_EQ(add_digits('x', 'y').error().message, "'x' is not a digit");
}

TEST(Error, TryAssignMovesValuesThatCannotBeCopied) {
  const auto increment = [](Result<std::unique_ptr<int>> input) -> Result<int> {
    SPLATVOL_TRY_ASSIGN(pointer, std::move(input));
    return *pointer + 1;
  };
  EXPECT_EQ(increment(std::make_unique<int>(41)).value(), 42);
}

TEST(Error, FailInPrefixesThePlaceAndKeepsTheCode) {
  const Result<int> inner = parse_digit('x');
  const Result<int> outer = fail_in("mesh.vtu", inner.error());
  EXPECT_EQ(outer.error().code, ErrorCode::invalid_data);
  EXPECT_EQ(outer.error().message, "mesh.vtu: 'x' is not a digit");
}

TEST(Error, MessagesAreOneLineThatATerminalCanShow) {
  const Status failed = fail(ErrorCode::invalid_data, "no attribute \"{}\"", "p\n\x1b[2J\xff");
  EXPECT_EQ(failed.error().message, "no attribute \"p??[2J?\"");
  EXPECT_EQ(fail_in("a\nb.vtu", failed.error()).value().message, "a?b.vtu: no attribute \"p??[2J?\"");
  EXPECT_EQ(one_line("é ∞\u009b"), "é ∞?");
}

}  // namespace
}  // namespace splatvol
