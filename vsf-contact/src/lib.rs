//! Signed distance fields and stick-slip contact of a robot with a point cloud
