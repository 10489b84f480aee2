// The alveolar ridge: a curve through the necks of the teeth, with the ridge's measures along it.
#pragma once

#include <vector>

#include "phantom/jaws_arch.h"

namespace gnathion {

class AlveolarRidge {
 public:
  explicit AlveolarRidge(const DentalArch& arch);

  /// The ridge at one place of the arch. Heights are told apically: they grow towards the roots.
  struct Station {
    Eigen::Vector2d point_mm, outward;
    double s_mm = 0.0;       ///< along the ridge
    double margin_mm = 0.0;  ///< height of the gingival margins
    double half_mm = 0.0;    ///< half the width of the teeth
    double lean = 0.0;       ///< how far the ridge goes outward per millimetre of depth
    double eminence = 0.6;   ///< 1 over a root, 0 between two
    double rim_mm = 0.0;     ///< height of the gingival margins, evened out: what the scan's end follows
    double toothless = 0.0;  ///< 1 behind the last molar
  };
  /// Where a point stands to the ridge.
  struct Local {
    Station at;
    double across_mm = 0.0;  ///< outward from the ridge's middle
    double depth_mm = 0.0;   ///< apically from the gingival margins
  };
  Local local(const Vector3& p_mm) const;

  const std::vector<Station>& stations() const { return stations_; }
  double apical() const { return apical_; }  ///< sign of z towards the roots
  double mean_margin_mm() const { return mean_margin_mm_; }
  double front_y_mm() const { return front_y_mm_; }  ///< of the foremost tooth's neck
  double end_y_mm() const { return end_y_mm_; }      ///< where the scan ends behind the last molars

 private:
  std::vector<Station> control_stations(const DentalArch& arch) const;
  void run_through(const std::vector<Station>& control);
  void smooth();
  void measure(const DentalArch& arch);
  void fill_table();
  std::size_t nearest(const Eigen::Vector2d& p) const;

  double apical_, mean_margin_mm_ = 0.0, end_y_mm_ = 0.0, front_y_mm_ = 0.0;
  std::vector<Station> stations_;
  Eigen::Vector2d table_origin_ = Eigen::Vector2d::Zero();
  int table_nx_ = 0, table_ny_ = 0;
  std::vector<std::uint16_t> table_;  ///< the nearest station, by node
};

}  // namespace gnathion
