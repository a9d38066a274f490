// Covariances of Haar wavelet coefficients of one process at all pairs of levels, computed once, for sums of products with
// many other processes.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <vector>

#include "gmwm/lag_pieces.hpp"
#include "gmwm/lag_series.hpp"
#include "gmwm/lag_sums.hpp"

namespace gmwm {

// The lags between two kinks, as sums with the number n(i) of pairs of coefficients, 0 <= i < count.
struct TablePiece {
  std::int64_t start = 0, count = 0;
  LagCount pairs{};
  double centre = 0;                                // n(0) D(0) if start is 0
  std::vector<double> values;                       // n(i) D(i), of a short piece only
  std::array<double, degree_most + 1> moments{};    // Σ n(i) (i / count)^r D(i)
  Falling::Values weights{};                        // of n(i) times the polynomial of D, a sum of the functions of `Falling`
  LagPiece covariance;
  std::size_t first = 0;                            // exponential of the first column
  std::vector<double> columns;                      // for each exponential E, F, E b^count and F b^count
};

class LagTable {
 public:
  using Values = std::shared_ptr<const std::vector<double>>;

  // `process` has only real decays, and no spikes.
  LagTable(std::span<const std::int64_t> levels, std::int64_t samples, bool diagonal, const LagProcess& process);

  const std::vector<std::int64_t>& levels() const { return levels_; }
  std::int64_t samples() const { return samples_; }
  bool diagonal() const { return diagonal_; }
  const std::vector<double>& decays() const { return decays_; }
  const TablePiece& piece(std::size_t place) const { return pieces_[place]; }
  // For each piece, D at the first and then at the last `lags` lags, or at all lags if there are fewer. They are kept.
  Values ends(std::int64_t lags) const;

 private:
  std::vector<std::int64_t> levels_;
  std::int64_t samples_;
  bool diagonal_;
  std::vector<double> decays_;
  std::vector<TablePiece> pieces_;
  mutable std::map<std::int64_t, Values> ends_;
  mutable std::mutex turn_;
};

// Constants of the products of the exponentials of a process with those of a table.
class TableProducts {
 public:
  TableProducts(const LagPieces& process, const LagTable& table);

  // Σ n(i) C(i) D(i) over a piece of the table, where C has the exponentials and the polynomial of `left`, without spikes
  // and echoes. `power` are z^count of all exponentials of the process, and `sums` those of the functions of `Falling` and
  // the exponentials of `left`.
  double sum(const LagPiece& left, const TablePiece& piece, const Complex* power, const Falling::Values& sums) const;
  // The same for an echo.
  double echo(const LagPiece& left, const TablePiece& piece);

 private:
  struct Close {
    std::size_t column;
    Complex difference;  // of the decays
    double distance;
  };
  struct Row {
    Complex decay, pole;
    std::vector<double> constants;    // for each column p, a b p², q and a q², p = 1 / (1 - a b), q = 1 / (b - a)
    std::vector<Close> close;         // columns for which a series may be needed
  };
  struct Turned {
    std::vector<Complex> pole, over_apart;  // of each column
  };
  double exponential(const Row& row, Complex E, Complex F, Complex end, const TablePiece& piece) const;
  const Turned& turned_by(double angle);

  const LagTable& table_;
  std::vector<Row> rows_;
  std::map<double, Turned> turned_;  // by angle
};

}  // namespace gmwm
