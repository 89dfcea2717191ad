// Tetrahedra that subdomains have found independently, each told once.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/temp_file.h"
#include "builder/mesh/moments.h"
#include "builder/mesh/ranked_tetrahedron.h"
#include "builder/sorting/record_spool.h"

namespace splatvol {

/// Tetrahedra with a corner at a subdomain's own points.
struct FoundTetrahedra {
  std::vector<Tetrahedron> corners = {};  // by ascending ranks
  std::vector<std::int8_t> signs = {};    // [tetrahedron]: RankedTetrahedron::sign
  std::vector<std::uint64_t> ranks = {};  // [corner's number]
  bool is_certain = true;                 // all points that decide were known
};

/// Passes tetrahedra on. All subdomains that own one of its corners should find a tetrahedron. The first of them that
/// is certain of all its own passes it on; if none of them is, the first of all. No tetrahedron is passed on twice.
class SharedTetrahedra {
 public:
  /// `begins`: [subdomain]: the rank of its first point, ascending; then the end. `folder`: for what cannot be decided
  /// yet.
  [[nodiscard]] static Result<std::unique_ptr<SharedTetrahedra>> create(std::vector<std::uint64_t> begins,
                                                                        const std::string& folder, TakeTetrahedra take);

  /// Adds the tetrahedra of the next subdomain.
  [[nodiscard]] Status add(const FoundTetrahedra& found);

  /// Called once, after all subdomains.
  [[nodiscard]] Status finish();

  /// The number of tetrahedra that some, but not all, subdomains with a corner have found. Whether they are passed on,
  /// the class's rule says. Requires finish().
  [[nodiscard]] std::uint64_t disputed() const { return disputed_; }

 private:
  // Hashes of tetrahedra, in the file.
  struct Votes {
    std::uint64_t offset, count, hash;
  };
  // The tetrahedra that subdomains have found, and whose lowest corner is in one subdomain.
  struct Ballot {
    std::vector<Votes> votes;   // one for each subdomain that found some
    std::uint64_t balance = 0;  // 0: all agree
  };
  // The subdomains of the corners, ascending, each once.
  struct Owners {
    std::array<std::size_t, 4> subdomains{};
    std::size_t count = 0;
  };

  SharedTetrahedra(std::vector<std::uint64_t> begins, const std::string& folder, TempFile votes, TakeTetrahedra take);
  [[nodiscard]] std::size_t subdomain_of(std::uint64_t rank) const;
  [[nodiscard]] Owners owners_of(const RankedTetrahedron& tetrahedron) const;
  [[nodiscard]] Status pass_on(const RankedTetrahedron& tetrahedron);
  [[nodiscard]] Status flush();
  [[nodiscard]] Status decide_pending();
  [[nodiscard]] Status store_votes();
  [[nodiscard]] Result<std::uint64_t> count_disputed(const Ballot& ballot) const;

  std::vector<std::uint64_t> begins_;
  TakeTetrahedra take_;
  std::vector<bool> certain_;              // [subdomain that was added]
  std::vector<RankedTetrahedron> passed_;  // to take_ next
  RecordSpool pending_;                    // of subdomains that are not certain; later ones may be
  TempFile votes_;
  std::vector<Ballot> ballots_;                                   // [subdomain]
  std::vector<std::pair<std::size_t, std::uint64_t>> new_votes_;  // of the present subdomain: ballot, hash
  std::uint64_t disputed_ = 0;
};

}  // namespace splatvol
