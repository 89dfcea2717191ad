// The words of OpenFOAM's files.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "builder/sources/openfoam/foam_stream.h"
#include "builder/sources/reader_error.h"

namespace splatvol {

/// How a file writes the numbers of its lists.
struct FoamFormat {
  bool binary = false;
  bool big_endian = false;
  int label_bytes = 4;
  int scalar_bytes = 8;
};

/// A file of a case.
struct FoamPlace {
  std::string path;
  std::string name;                       // for messages: in the case's folder
  std::string case_folder;                // that of `#include "$FOAM_CASE/file"`
  std::optional<std::size_t> block = {};  // of a file that holds those of several processors
};

/// A word, or what stands between words.
struct FoamToken {
  enum class Kind { end, mark, word, text, macro, directive };  // `mark`: one of { } ( ) [ ] ;
  Kind kind = Kind::end;
  std::string text;  // of a text without its quotes, of a macro and a directive with $ and #

  [[nodiscard]] bool is(char mark) const { return kind == Kind::mark && text[0] == mark; }
  [[nodiscard]] bool is_word(std::string_view word) const { return kind == Kind::word && text == word; }
};

/// Reads a file word by word. It leaves out comments, and follows `#include` to files in the case's folder, 16 deep and
/// 1000 in all. It throws a ReaderError that names the file, and the line where there is one. Safe on untrusted bytes.
class FoamReader {
 public:
  /// Opens a file, and reads its header (FoamFile) if there is one. Of a file that holds those of several processors,
  /// the reader sees a block only. Throws if the file is empty, ends within its header, or has no such block.
  explicit FoamReader(const FoamPlace& place);

  /// The class that the header states; empty: there is no header.
  [[nodiscard]] const std::string& class_name() const { return class_; }

  /// The format of the file that is being read: this one, or one that it includes.
  [[nodiscard]] const FoamFormat& format() const { return sources_.back().format; }
  [[nodiscard]] FoamStream& stream() { return *sources_.back().stream; }

  FoamToken next();
  FoamToken peek();

  /// Reads the next word, and throws if it is not this mark.
  void expect(char mark);

  /// Whether `#include` is followed. If not, next() returns it, and its text is the next word.
  void follow_includes(bool follows) { follows_includes_ = follows; }

  /// Takes the rest of an entry up to its `;`, or of a block up to its `}`, with all that they hold. Lists of numbers
  /// may be binary. Returns false if the file has a list whose bytes cannot be counted: what follows stays unread.
  bool skip_entry();
  bool skip_block();

  /// Takes the list behind a word such as "List<scalar>". Returns false if its bytes cannot be counted.
  bool skip_list(const std::string& type);

  /// Takes white space and comments.
  void skip_space();

  template <class... Args>
  [[noreturn]] void fail(fmt::format_string<Args...> text, const Args&... args) const {
    fail_with(text, fmt::make_format_args(args...));
  }

 private:
  struct Source {
    std::unique_ptr<FoamStream> stream;
    FoamFormat format;
    std::string folder;     // of the file
    std::string canonical;  // path
  };

  [[noreturn]] void fail_with(fmt::string_view text, fmt::format_args arguments) const;
  void read_header();
  void enter_block(std::size_t block);
  bool skip_until(char end);
  FoamToken read_token();
  FoamToken read_text();
  FoamToken read_braces();
  FoamToken skip_code();
  FoamToken read_word();
  void include(const std::string& file, bool optional);
  [[nodiscard]] std::string resolve(const std::string& file) const;

  std::string case_folder_, class_, inner_class_;
  std::vector<Source> sources_;  // the file, and those that are being included
  std::optional<FoamToken> peeked_;
  std::size_t files_ = 1;
  bool follows_includes_ = true, inner_is_binary_ = false;
};

/// Whether a file begins with a header, or ends before it could: then FoamReader tells. Throws if it is empty, begins
/// with zeros, or cannot be read.
[[nodiscard]] bool has_foam_header(const FoamPlace& place);

}  // namespace splatvol
