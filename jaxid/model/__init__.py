"""The model: u = φᵀθ + Δ, with θ in the prior box Ω_θ and |Δ| ≤ δ.

Regressors, the disturbance bound, and the interval arithmetic that bounds both.
"""
