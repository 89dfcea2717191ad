#include "tools/tool.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <new>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/support/results.h"

namespace splatvol {
namespace {

using namespace ::testing;

std::uint64_t bytes_or_zero(const std::string& text) { return parse_bytes(text).value_or(0); }

TEST(ParseBytes, TakesPowersOf1024) {
  EXPECT_EQ(bytes_or_zero("65536"), 65536U);
  EXPECT_EQ(bytes_or_zero("65536B"), 65536U);
  EXPECT_EQ(bytes_or_zero("64K"), 65536U);
  EXPECT_EQ(bytes_or_zero("64KiB"), 65536U);
  EXPECT_EQ(bytes_or_zero("64KB"), 65536U);
  EXPECT_EQ(bytes_or_zero("512M"), std::uint64_t{512} << 20);
  EXPECT_EQ(bytes_or_zero("1.5G"), std::uint64_t{3} << 29);
  EXPECT_EQ(bytes_or_zero("0.5GiB"), std::uint64_t{1} << 29);
  EXPECT_EQ(bytes_or_zero("2T"), std::uint64_t{2} << 40);
}

TEST(ParseBytes, TakesZeroAndTheLargestOffsetOfAFile) {
  ASSERT_TRUE(parse_bytes("0"));
  EXPECT_EQ(*parse_bytes("0"), 0U);
  EXPECT_EQ(bytes_or_zero("8388607T"), (std::uint64_t{1} << 63) - (std::uint64_t{1} << 40));
  EXPECT_FALSE(parse_bytes("8388608T"));
}

TEST(ParseBytes, RefusesWhatIsNoSizeAndRepeatsIt) {
  for (const std::string text : {"",      "B",    "K",     "G2", "2X",    "2 G", "2GG", "2iB",  "2BiB",  "2Gi",
                                 "2GiBs", "2,5G", "1..5G", "-1", "-0.5K", "nan", "inf", "infG", "1e400", "--memory"}) {
    EXPECT_THAT(parse_bytes(text), test::FailsWith(ErrorCode::invalid_argument, HasSubstr("'" + text + "'")));
  }
}

struct Outcome {
  int exit_code;
  std::string out, err;
};

/// Runs a tool with one required option, --in, and the work `body`.
Outcome run(std::vector<std::string> arguments, const std::function<Status()>& body) {
  CommandLine app("Tests programs", "svtest");
  std::string input;
  app.add_option("--in", input, "")->required();

  std::string name = "svtest";
  std::vector<char*> argv{name.data()};
  for (std::string& argument : arguments) argv.push_back(argument.data());

  testing::internal::CaptureStdout();
  testing::internal::CaptureStderr();
  const int exit_code = run_tool(app, static_cast<int>(argv.size()), argv.data(), body);
  std::string out = testing::internal::GetCapturedStdout();
  return {exit_code, out, testing::internal::GetCapturedStderr()};
}

TEST(RunTool, DoneIsZeroAndSilent) {
  const Outcome outcome = run({"--in", "x"}, [] { return Status{}; });
  EXPECT_EQ(outcome.exit_code, 0);
  EXPECT_EQ(outcome.out + outcome.err, "");
}

TEST(RunTool, BadDataIsOneWithOneLine) {
  const Outcome outcome = run({"--in", "x"}, []() -> Status { return fail(ErrorCode::invalid_data, "x.svol: bad"); });
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_EQ(outcome.out, "");
  EXPECT_EQ(outcome.err, "svtest: x.svol: bad\n");
}

TEST(RunTool, ExceptionsEndAsErrors) {
  const Outcome error = run({"--in", "x"}, []() -> Status { throw std::runtime_error("thrown"); });
  EXPECT_EQ(error.exit_code, 1);
  EXPECT_EQ(error.err, "svtest: thrown\n");

  const Outcome memory = run({"--in", "x"}, []() -> Status { throw std::bad_alloc(); });
  EXPECT_EQ(memory.exit_code, 1);
  EXPECT_EQ(memory.err, "svtest: not enough memory\n");
}

TEST(RunTool, WrongUsageIsTwoAndRunsNothing) {
  const std::vector<std::vector<std::string>> command_lines = {
      {}, {"--in"}, {"--unknown"}, {"--in", "x", "surplus"}, {"--in", "x", "--unknown"}};
  for (const auto& arguments : command_lines) {
    bool ran = false;
    const Outcome outcome = run(arguments, [&ran] {
      ran = true;
      return Status{};
    });
    EXPECT_EQ(outcome.exit_code, 2) << testing::PrintToString(arguments);
    EXPECT_NE(outcome.err, "") << testing::PrintToString(arguments);
    EXPECT_FALSE(ran) << testing::PrintToString(arguments);
  }
}

TEST(RunTool, HelpAndVersionPrintAndAreZero) {
  const auto never = []() -> Status { return fail(ErrorCode::io, "ran"); };
  const Outcome help = run({"--help"}, never);
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_THAT(help.out, HasSubstr("--in"));

  const Outcome version = run({"--version"}, never);
  EXPECT_EQ(version.exit_code, 0);
  EXPECT_THAT(version.out, StartsWith("svtest "));
  EXPECT_EQ(help.err + version.err, "");
}

TEST(ProgressBar, PrintsNothingIntoAPipe) {
  testing::internal::CaptureStderr();
  {
    ProgressBar bar("reading");
    bar.update(0);
    bar.update(1);
  }
  EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
}

}  // namespace
}  // namespace splatvol
